"""Writes a report as an HTML page in one file, with curves and video; makes no web requests.

A user can attach the page to an issue or a CI run. The page's content security policy forbids all
web requests.
"""

from __future__ import annotations

import base64
import contextlib
import io
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from drop_physics.errors import DropError, check_suffix
from drop_physics.figures import panel_plot
from drop_physics.files.outputs import check_apart, check_target
from drop_physics.files.whole import written_whole
from drop_physics.messages import Message, harmless, translated
from drop_physics.report.blocks import Graphs, Report
from drop_physics.report.html import CURVES, html_of, time_html
from drop_physics.stages.render import ShortFilm
from drop_physics.stages.render import film_of as drawn_film

if TYPE_CHECKING:
    from drop_physics.printable import Printable

POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
STYLE = """
:root { color-scheme: light dark; --text: #1f2328; --faint: #5f6670; --page: #ffffff;
  --line: #d0d7de; --mark: #fff1c2; --advice: #1a7f37; --broken: #cf222e }
@media (prefers-color-scheme: dark) { :root { --text: #e6edf3; --faint: #9aa4af; --page: #0d1117;
  --line: #30363d; --mark: #4d3b00; --advice: #57ab5a; --broken: #ff7b72 } }
body { font: 1rem/1.5 system-ui, sans-serif; color: var(--text); background: var(--page);
  margin: 2rem auto; padding: 0 1rem; max-width: 60rem }
h1 { font-size: 1.3rem } h2 { font-size: 1.05rem; margin: 1.5rem 0 .3rem }
h3 { font-size: 1rem; margin: 1.2rem 0 0 }
p { margin: .3rem 0 } .dim, .note, .code { color: var(--faint) } .code { font-size: .85rem }
.yellow { color: #9a6700 } .advice { color: var(--advice) }
section { margin: 1.2rem 0 }
.wide { overflow-x: auto }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums }
th, td { padding: .15rem .8rem .15rem 0; text-align: left; vertical-align: top }
th { color: var(--faint); font-weight: normal } th, td:not(:last-child) { white-space: nowrap }
.total td { font-weight: bold } .failed td { color: var(--broken) }
.facts th { color: var(--text); font-weight: bold }
.findings li { margin: 1rem 0 } .findings .broken b { color: var(--broken) }
pre { border: 1px solid var(--line); border-radius: 6px; padding: .5rem; overflow-x: auto;
  font-size: .85rem; line-height: 1.2; white-space: pre }
mark { background: var(--mark); color: inherit }
.moment { display: flex; flex-wrap: wrap; align-items: center; gap: 1rem }
.moment .curves { flex: 2 1 24rem } .moment .frame { flex: 1 1 12rem }
a { color: inherit } .facts td { white-space: pre-wrap } .facts td.when { white-space: nowrap }
.moments { display: flex; flex-wrap: wrap; gap: 1rem }
figure { margin: 0; width: 13rem } figure:target { outline: 2px solid var(--advice) }
figcaption { color: var(--faint); font-size: .85rem; text-align: center }
img { max-width: 100% } .strip { display: none }
@media print {
  :root { font-size: 12px } body { margin: 0; padding: 0; max-width: none }
  li, table, img, pre { break-inside: avoid } h3, h2 { break-after: avoid }
  pre { white-space: pre-wrap; overflow: visible } .wide { overflow: visible }
  .film { display: none } .strip { display: block; width: 100% }
}
"""
MOMENTS = 4
"""Number of video frames that replace the video in print."""
LANGUAGE = Message("en")
"""HTML language code of the page."""


def check_page(page: Path, *, inputs: Sequence[Path], force: bool) -> None:
    """Check that a page can be written, before any work is done for it.

    Raises
    ------
    ScenarioError
        If the page's name does not end in .html.
    OutputError
        If the file exists and `force` is false, or the same command reads or writes the file.
    """
    check_suffix("--html", page, (".html",))
    check_apart([page], inputs=inputs)
    check_target(page, force=force)


def write_page(
    result: Printable,
    page: Path,
    *,
    force: bool,
    film_of: Path | None = None,
    **how: object,
) -> None:
    """Write a result's report as an HTML page with curves.

    The page shows a video of the recording `film_of`, if anything in that recording can be drawn.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    report: Report = result.report(**how)
    films = _films(film_of)
    frames = FilmFrames(films)
    shown = "\n".join([*_curves(report, frames), *_film(films)])
    told = "".join(html_of(report, moment=frames.link if films else time_html))
    told = told.replace(CURVES, shown, 1).replace(CURVES, "")
    title = report.title or getattr(report.verdict, "text", "drop")
    text = f"""<!doctype html>
<html lang="{translated(LANGUAGE)}">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<meta name="viewport" content="width=device-width">
<title>{_said(title)}</title>
<style>{STYLE}</style>
</head>
<body>
{told}{"".join(frames.figures())}
</body>
</html>
"""
    with written_whole(page, force=force) as file:
        file.write(text.encode("utf-8", "replace"))


def _films(recording: Path | None) -> list[ShortFilm]:
    """Return a recording's video for a light and a dark page; empty if nothing can be drawn."""
    if recording is not None:
        with contextlib.suppress(DropError):
            return [drawn_film(recording, dark=dark) for dark in (False, True)]
    return []


class FilmFrames:
    """The video images at the moments that a page mentions.

    Parameters
    ----------
    films
        The videos for a light and for a dark page; empty without a video.
    """

    def __init__(self, films: Sequence[ShortFilm]) -> None:
        self._films = films
        self._shown: set[int] = set()
        """Frames that the page links to."""

    def link(self, at_s: float) -> str:
        """Return an HTML link to the image nearest to a time."""
        place = self._nearest(at_s)
        self._shown.add(place)
        return f'<a href="#frame-{place}">{time_html(at_s)}</a>'

    def picture(self, at_s: float) -> str | None:
        """Return the image nearest to a time as HTML; None without a video."""
        return self._picture(self._nearest(at_s)) if self._films else None

    def figures(self) -> Iterator[str]:
        """Yield the images that are linked to, each with its time."""
        if self._shown:
            yield '<section class="moments">'
            for place in sorted(self._shown):
                time = time_html(self._films[0].times_s[place])
                yield f'<figure id="frame-{place}">{self._picture(place)}'
                yield f"<figcaption>{time}</figcaption></figure>"
            yield "</section>"

    def _nearest(self, at_s: float) -> int:
        times_s = self._films[0].times_s
        return min(range(len(times_s)), key=lambda place: abs(times_s[place] - at_s))

    def _picture(self, place: int) -> str:
        light, dark = (_data(_frame(film, place), "png") for film in self._films)
        return _picture("frame", light, dark)


def _curves(report: Report, frames: FilmFrames) -> Iterator[str]:
    """Yield a report's plots for a light or dark page, with the image of the marked moment."""
    for section in report.sections:
        for block in section.blocks:
            if isinstance(block, Graphs) and (plot := block.plot()).panels:
                light, dark = (
                    _data(panel_plot.render(plot, "svg", dark=dark), "svg+xml")
                    for dark in (False, True)
                )
                curves = _picture("curves", light, dark)
                at_s = plot.panels[0].moment_s
                if at_s is not None and (frame := frames.picture(at_s)) is not None:
                    curves = f'<div class="moment">{curves}{frame}</div>'
                yield curves


def _film(films: Sequence[ShortFilm]) -> Iterator[str]:
    """Yield the video for a light or dark page, with images that replace it in print."""
    if films:
        light, dark = films
        yield _picture("film", _data(light.gif, "gif"), _data(dark.gif, "gif"))
        yield f'<img class="strip" alt="" src="{_data(_strip(light.gif), "gif")}">'


def _frame(film: ShortFilm, place: int) -> bytes:
    """Return one frame of a video as an encoded image."""
    with Image.open(io.BytesIO(film.gif)) as frames:
        frames.seek(min(place, getattr(frames, "n_frames", 1) - 1))
        stream = io.BytesIO()
        frames.convert("RGB").save(stream, "png")
    return stream.getvalue()


def _picture(name: str, light: str, dark: str) -> str:
    return (
        f'<picture class="{name}"><source media="(prefers-color-scheme: dark)" '
        f'srcset="{dark}"><img alt="" src="{light}"></picture>'
    )


def _data(picture: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode()}"


def _strip(film: bytes) -> bytes:
    """Return several frames of a video side by side, including the first and the last."""
    with Image.open(io.BytesIO(film)) as frames:
        width, height = frames.size
        strip = Image.new("RGB", (MOMENTS * width, height))
        for number in range(MOMENTS):
            frames.seek(number * (getattr(frames, "n_frames", 1) - 1) // (MOMENTS - 1))
            strip.paste(frames.convert("RGB"), (number * width, 0))
        stream = io.BytesIO()
        strip.save(stream, "gif")
    return stream.getvalue()


def _said(text: str) -> str:
    return escape(harmless(translated(text)))

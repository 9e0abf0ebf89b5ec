"""Shows results in Python: as text and, in notebooks, as HTML with tables and images."""

from __future__ import annotations

import base64
import importlib
import re
import uuid
from collections.abc import Iterator
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.text import Text

from drop_physics.errors import DropError, in_parameters
from drop_physics.messages import harmless
from drop_physics.report import html
from drop_physics.report.blocks import Facts, File, Graphs, Report
from drop_physics.report.terminal import lines_of
from drop_physics.report.words import NEXT

if TYPE_CHECKING:
    from drop_physics.figures.plot import Plot
    from drop_physics.printable import Printable

PICTURES = {".gif": "gif", ".png": "png", ".webp": "webp", ".apng": "apng", ".svg": "svg+xml"}
"""Media types of images that browsers show, by file suffix."""
HIDDEN = """<div id="{name}">{film}<p>{note}</p></div><script>{{
const film = document.getElementById("{name}")
const cell = film.closest(".jp-OutputArea, .output, .cell-output, body")
const seen = setInterval(() => {{
  if (cell.querySelector("canvas")) {{ film.style.display = "none"; clearInterval(seen) }}
}}, 500)
setTimeout(() => clearInterval(seen), 60000)
}}</script>"""
"""HTML of a video that disappears when the viewer is shown, but stays in a page without scripts or
widgets."""
HEADING = "h4"
"""CSS style of a result's first line."""


MORE = re.compile(r": (?:see )?--(?:verbose|json|account)\b[^\n<]*")
"""Pattern of a hint to a command-line option that shows more; the hint is removed in Python."""


def text_of(result: Printable) -> str:
    """Return a result's report as the terminal shows it, without colours."""
    lines = (Text.from_markup(harmless(line), emoji=False) for line in lines_of(result.report()))
    return "\n".join(line.plain.rstrip() for line in lines)


def in_python(text: str) -> str:
    """Replace command-line options in a text by the names of Python parameters."""
    return in_parameters(MORE.sub(": as_json()", text))


def _without_commands(report: Report) -> Report:
    """Remove a report's commands to run next, which are for a terminal."""
    sections = [
        replace(
            section,
            blocks=[
                replace(block, rows=[row for row in block.rows if row.title != NEXT])
                if isinstance(block, Facts)
                else block
                for block in section.blocks
            ],
        )
        for section in report.sections
    ]
    return replace(report, sections=sections)


def moment_in_python(at_s: float) -> str:
    """Return the HTML of the Python call that opens the viewer at a time."""
    return f"<code>.view(at_s={at_s:g})</code>"


def html_of(result: Printable) -> str:
    """Return a result's report as HTML, followed by tables and images."""
    report = _without_commands(result.report())
    shown = html.html_of(report, HEADING, moment_in_python)
    told = in_python("\n".join(shown).replace(html.CURVES, ""))
    styled = f'<div style="font-family: monospace">\n{told}\n</div>'
    return "\n".join([styled, *_tables(result), *_pictures(report)])


def _tables(result: Any) -> Iterator[str]:  # noqa: ANN401 - of any kind
    """Yield the table of all rows and columns of a sweep; the text shows only a part of these."""
    from drop_physics.stages.sweep import Sweep

    if isinstance(result, Sweep):
        yield result.table()._repr_html_()


def _pictures(report: Report) -> list[str]:
    """Return a report's images: its image files or, without any, its curves drawn."""
    blocks = [block for section in report.sections for block in section.blocks]
    rows = [row for block in blocks if isinstance(block, Facts) for row in block.rows]
    paths = [Path(row.path) for row in rows if isinstance(row, File)]
    files = [
        _picture(path.read_bytes(), PICTURES[path.suffix])
        for path in paths
        if path.suffix in PICTURES and path.is_file()
    ]
    if files:
        return files
    plots = [block.plot() for block in blocks if isinstance(block, Graphs)]
    return [_drawn(plot) for plot in plots if plot.panels or plot.title]


def _drawn(plot: Plot) -> str:
    from drop_physics.figures import panel_plot  # loads matplotlib

    return _picture(panel_plot.render(plot, "png", dark=False), "png")


class Viewed:
    """Rerun's viewer in a notebook, or a video or plot where the viewer cannot be shown."""

    def __init__(self, result: Any, height_px: int, at_s: float | None) -> None:  # noqa: ANN401
        from drop_physics.stages.render import film_of
        from drop_physics.stages.view import in_notebook, recording_of

        self._widget, note = None, ""
        recording = recording_of(result)
        try:
            self._widget = in_notebook(result, height_px, at_s)
        except DropError as missing:  # the viewer
            note = escape(str(missing))
        try:
            film = _picture(film_of(recording).gif, "gif")
        except DropError:  # of nothing that can be drawn
            film = "\n".join(_pictures(result.report()))
        self._html = HIDDEN.format(name=f"drop-{uuid.uuid4().hex}", film=film, note=note)

    def _repr_html_(self) -> str:
        return self._html

    def _ipython_display_(self) -> None:
        shell = importlib.import_module("IPython.display")
        shell.display(shell.HTML(self._html))
        if self._widget is not None:
            shell.display(self._widget)


def _picture(content: bytes, kind: str) -> str:
    data = base64.b64encode(content).decode()
    return f'<img style="max-width: 100%" src="data:image/{kind};base64,{data}">'

"""Styles plots for light and dark pages, and chooses readable units.

The user's matplotlib settings have no effect: the same data always give the same bytes.
"""

from __future__ import annotations

import contextlib
import functools
import io
import logging
import math
import pathlib
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib
from matplotlib import font_manager
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.text import Text

from drop_physics.figures.gif import MADE_BY_DROP
from drop_physics.figures.theme import DARK, LIGHT, Theme
from drop_physics.messages import Message, harmless, translated, wrapped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_IN = 8.0
"""Width of every plot, so that text appears equally large on a page [inch]."""
EDGE_IN = 0.16
"""Margin around a plot [inch]."""
TITLE, LINE = 68, 110
"""Number of characters that fit in a line of the title, and in a line below the title."""
MOST_TITLE, MOST_LINES = 2, 5
"""Largest number of lines of the title, and of lines below it."""
TITLE_IN, LINE_IN = 0.29, 0.19
"""Height of a title line, and of a line below it [inch]."""
MOST_NAME = 42
"""Largest number of characters shown of a curve's name."""
LEGEND = 0.6
"""Largest height of a legend, as a share of its panel's part of the figure."""
DASHED = (0, (4, 3))
Build = Callable[[Theme], Figure]

JAPANESE = (
    "Noto Sans CJK JP", "Noto Sans JP", "IPAexGothic", "IPAGothic", "TakaoGothic", "VL Gothic",
    "Hiragino Sans", "Hiragino Kaku Gothic ProN", "Yu Gothic", "Meiryo", "MS Gothic",
)  # fmt: skip
"""Japanese fonts of common operating systems; the first installed one is used."""


@functools.cache
def japanese_font() -> str | None:
    """Return the name of an installed Japanese font; None if there is none."""
    manager = font_manager.fontManager
    return _first_japanese(manager.ttflist) or _first_japanese(_installed_since(manager))


def _first_japanese(fonts: Iterable[font_manager.FontEntry]) -> str | None:
    names = {font.name for font in fonts if pathlib.Path(font.fname).is_file()}
    return next((name for name in JAPANESE if name in names), None)


def _installed_since(manager: font_manager.FontManager) -> list[font_manager.FontEntry]:
    """Return fonts that were installed after matplotlib made its list, and add them to it."""
    known = {font.fname for font in manager.ttflist}
    for path in font_manager.findSystemFonts():
        if path not in known:
            with contextlib.suppress(OSError, RuntimeError):  # a font that cannot be read
                manager.addfont(path)
    return [font for font in manager.ttflist if font.fname not in known]


def label(template: str, /, **values: object) -> str:
    """Translate a message or template for the user, if a font for the language is installed."""
    message = template if isinstance(template, Message) else Message(template, **values)
    shown = translated(message)
    # A name may hold what no XML may, and so no SVG: control characters.
    return harmless(shown if shown == message or japanese_font() is not None else str(message))


def lines_of(texts: Sequence[str], columns: int, most: int) -> str:
    """Translate texts and wrap them to at most `most` lines."""
    lines = [line for text in texts for line in wrapped(label(text), columns)]
    if len(lines) > most:
        lines = [*lines[: most - 1], f"{lines[most - 1]} …"]
    half = columns // 2  # names differ at their ends
    return "\n".join(
        f"{line[:half]}…{line[-half:]}" if len(line) > columns + 2 else line for line in lines
    )


def families() -> list[str]:
    """Return the font names of a plot, in the order in which they are searched for a character."""
    # The first choice of sans-serif, DejaVu Sans, comes with matplotlib: alike on every machine.
    font = japanese_font() if label("time [{unit}]", unit="s") != "time [s]" else None
    return ["sans-serif"] if font is None else ["sans-serif", font]


@contextlib.contextmanager
def themed(theme: Theme) -> Iterator[None]:
    """Configure matplotlib for one figure, and restore its settings afterwards."""
    fonts = logging.getLogger("matplotlib.font_manager")
    level = fonts.level
    with matplotlib.rc_context(), warnings.catch_warnings(), contextlib.ExitStack() as after:
        after.callback(fonts.setLevel, level)
        fonts.setLevel(logging.ERROR)  # of a font without a bold face, as Japanese ones often are
        warnings.filterwarnings("ignore", "Glyph")  # a character that no font has is drawn as a box
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(
            {
                "font.family": families(),
                "font.size": 11,
                "figure.facecolor": theme.page,
                "savefig.facecolor": theme.page,
                "axes.facecolor": theme.page,
                "axes.edgecolor": theme.faint,
                "axes.labelcolor": theme.text,
                "axes.labelsize": 11,
                "axes.spines.top": False,
                "axes.spines.right": False,
                "axes.titlesize": 11,
                "axes.formatter.useoffset": False,
                "axes.unicode_minus": True,
                "text.color": theme.text,
                "text.parse_math": False,
                "xtick.color": theme.faint,
                "ytick.color": theme.faint,
                "xtick.labelsize": 10,
                "ytick.labelsize": 10,
                "svg.fonttype": "none",  # text stays text
                "svg.hashsalt": "drop",  # identifiers are not random
            }
        )
        yield


def figure_of(title: str, lines: Sequence[str], height_in: float, theme: Theme) -> Figure:
    """Return a figure with a title and lines below it; `height_in` is the panels' height [inch].

    matplotlib lays out the panels below, so that no label is cut off.
    """
    titled, said = lines_of([title], TITLE, MOST_TITLE), lines_of(lines, LINE, MOST_LINES)
    below_in = EDGE_IN + TITLE_IN * (1 + titled.count("\n"))
    head_in = below_in + LINE_IN * (1 + said.count("\n")) * bool(said) + 0.2
    whole_in = head_in + height_in
    figure = Figure(figsize=(WIDTH_IN, whole_in), dpi=150)
    head(figure, head_in / whole_in)
    put = functools.partial(figure.text, EDGE_IN / WIDTH_IN, va="top", linespacing=1.3)
    put(1 - EDGE_IN / whole_in, titled, size=14, weight="bold")
    put(1 - below_in / whole_in, said, size=10, color=theme.faint)
    return figure


def head(figure: Figure, share: float) -> None:
    """Reserve this share of a figure's height for its title."""
    engine = ConstrainedLayoutEngine(
        w_pad=EDGE_IN, h_pad=0.06, wspace=0, hspace=0, rect=(0, 0, 1, 1 - share)
    )
    figure.set_layout_engine(engine)


def name_curves(
    axes: Axes, curves: Iterable[tuple[str, float, str]], *, columns: int, size: float
) -> None:
    """Write a panel's legend beside it, in the curves' colours, ordered by the curves' height.

    Parameters
    ----------
    axes
        The axes of the panel.
    curves
        Name, last value and colour of each curve.
    columns
        Number of characters in a line of a name.
    size
        Font size [points].
    """
    named = sorted(curves, key=lambda curve: -curve[1])
    labels = [lines_of([name], columns, MOST_NAME // columns) for name, _, _ in named]
    lines = sum(name.count("\n") + 1.5 for name in labels)
    figure = axes.get_figure(root=True)
    assert figure is not None
    room = LEGEND * 72 * figure.get_figheight() / len(figure.axes)
    axes.legend(
        [Line2D([], [], color=colour) for _, _, colour in named],
        labels,
        labelcolor=[colour for _, _, colour in named],
        loc="upper left",
        bbox_to_anchor=(1, 1),
        borderaxespad=0,
        frameon=False,
        fontsize=min(size, room / max(lines, 1)),
        handlelength=0,
        labelspacing=0.2,
    )


SMALLEST_FONT_PX = 2.0
"""Smallest font size of a text that is shrunk to fit [px]."""


def laid_out(figure: Figure) -> Figure:
    """Lay out a figure such that every text fits into it."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    end = figure.bbox.x1 - 4
    for text in figure.findobj(Text):
        while (box := text.get_window_extent()).x0 < end < box.x1:
            smaller = 0.95 * float(text.get_fontsize())
            if smaller * figure.dpi / 72 < SMALLEST_FONT_PX:
                break  # no reader could tell, and fonts have no smaller size
            text.set_fontsize(smaller)
    return figure


def rendered(build: Build, format: str, *, dark: bool) -> bytes:  # noqa: A002
    """Render a figure as `png` or `svg`, for a light or dark page; the bytes are reproducible."""
    theme, stream = DARK if dark else LIGHT, io.BytesIO()
    with themed(theme):
        made = {"Software": None, "Comment": MADE_BY_DROP.decode()}
        metadata = {"Date": None} if format == "svg" else made
        build(theme).savefig(stream, format=format, metadata=metadata)
    return stream.getvalue()


@dataclass(frozen=True)
class Unit:
    """A unit for displaying SI values: shown = value * per_si."""

    name: str
    per_si: float


METRES = (Unit("km", 1e-3), Unit("m", 1.0), Unit("mm", 1e3), Unit("µm", 1e6), Unit("nm", 1e9))
JOULES = (Unit("J", 1.0), Unit("mJ", 1e3), Unit("µJ", 1e6), Unit("nJ", 1e9))
SECONDS = (Unit("s", 1.0), Unit("ms", 1e3), Unit("µs", 1e6))


def unit_for(largest: float, units: tuple[Unit, ...], *, usual: str) -> Unit:
    """Return the unit in which the largest of the values is most readable.

    The usual unit is kept if the largest value is 0.01 to 9999 of it; otherwise the largest unit is
    chosen in which the value is at least 1.

    Parameters
    ----------
    largest
        Largest magnitude of the values, in SI units.
    units
        Units to choose from, largest first.
    usual
        Name of the usual unit, which is also used if all values are zero.
    """
    keep = next(unit for unit in units if unit.name == usual)
    if largest == 0 or not math.isfinite(largest) or 0.01 <= largest * keep.per_si < 1e4:
        return keep
    return next((unit for unit in units if largest * unit.per_si >= 1), units[-1])

"""How plots look: one style for light and dark pages, and numbers in readable units.

The user's own matplotlib settings have no effect: the same table gives the same bytes.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import math
import pathlib
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib
from matplotlib import font_manager

from drop_physics.figures.gif import MADE_BY_DROP
from drop_physics.figures.ink import DARK, LIGHT, Ink
from drop_physics.messages import Message, translated

if TYPE_CHECKING:
    from typing import BinaryIO

    from matplotlib.figure import Figure

DASHED = (0, (4, 3))


JAPANESE = (
    "Noto Sans CJK JP", "Noto Sans JP", "IPAexGothic", "IPAGothic", "TakaoGothic", "VL Gothic",
    "Hiragino Sans", "Hiragino Kaku Gothic ProN", "Yu Gothic", "Meiryo", "MS Gothic",
)  # fmt: skip
"""Japanese fonts of the usual systems; the first that is installed is used."""


@functools.cache
def japanese_font() -> str | None:
    """Return a font for Japanese; None where none is installed."""
    manager = font_manager.fontManager
    return _first_japanese(manager.ttflist) or _first_japanese(_installed_since(manager))


def _first_japanese(fonts: Iterable[font_manager.FontEntry]) -> str | None:
    names = {font.name for font in fonts if pathlib.Path(font.fname).is_file()}
    return next((name for name in JAPANESE if name in names), None)


def _installed_since(manager: font_manager.FontManager) -> list[font_manager.FontEntry]:
    """Return the fonts that were installed after matplotlib had made its list, and add them."""
    known = {font.fname for font in manager.ttflist}
    for path in font_manager.findSystemFonts():
        if path not in known:
            with contextlib.suppress(OSError, RuntimeError):  # a font that cannot be read
                manager.addfont(path)
    return [font for font in manager.ttflist if font.fname not in known]


def words(template: str, /, **values: object) -> str:
    """Return a message, or a template's, in the reader's language if there is a font for it."""
    message = template if isinstance(template, Message) else Message(template, **values)
    shown = translated(message)
    return shown if shown == message or japanese_font() is not None else str(message)


def families() -> list[str]:
    """Return the fonts of a plot, which are searched in this order for each letter."""
    # The first choice of sans-serif, DejaVu Sans, comes with matplotlib: alike on every machine.
    font = japanese_font() if words("time [{unit}]", unit="s") != "time [s]" else None
    return ["sans-serif"] if font is None else ["sans-serif", font]


@contextlib.contextmanager
def _regular_for_bold() -> Iterator[None]:
    """Let a font without a bold face, as Japanese fonts often are, be regular without a warning."""
    fonts = logging.getLogger("matplotlib.font_manager")
    level = fonts.level
    fonts.setLevel(logging.ERROR)
    try:
        yield
    finally:
        fonts.setLevel(level)


@contextlib.contextmanager
def plain(ink: Ink) -> Iterator[None]:
    """Set matplotlib up for one figure, and leave its settings as they were."""
    with matplotlib.rc_context(), _regular_for_bold():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(
            {
                "font.family": families(),
                "font.size": 11,
                "figure.facecolor": ink.page,
                "savefig.facecolor": ink.page,
                "axes.facecolor": ink.page,
                "axes.edgecolor": ink.faint,
                "axes.labelcolor": ink.text,
                "axes.labelsize": 11,
                "axes.spines.top": False,
                "axes.spines.right": False,
                "axes.formatter.useoffset": False,
                "axes.unicode_minus": True,
                "text.color": ink.text,
                "text.parse_math": False,
                "xtick.color": ink.faint,
                "ytick.color": ink.faint,
                "xtick.labelsize": 10,
                "ytick.labelsize": 10,
                "legend.frameon": False,
                "legend.fontsize": 11,
                "svg.fonttype": "none",  # text stays text
                "svg.hashsalt": "drop",  # identifiers are not random
            }
        )
        yield


def save(
    build: Callable[[Ink], Figure],
    target: pathlib.Path | BinaryIO,
    *,
    format: str,  # noqa: A002
    dark: bool,
) -> None:
    """Draw a figure for a light or a dark page, and write it; the same one gives the same bytes."""
    ink = DARK if dark else LIGHT
    with plain(ink), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # a character that no font has is drawn as a box
        made = {"Software": None, "Comment": MADE_BY_DROP.decode()}
        metadata = {"Date": None} if format == "svg" else made
        build(ink).savefig(target, format=format, metadata=metadata)


@dataclass(frozen=True)
class Unit:
    """A unit to show SI values in: shown = value * per_si."""

    name: str
    per_si: float


METRES = (Unit("km", 1e-3), Unit("m", 1.0), Unit("mm", 1e3), Unit("µm", 1e6), Unit("nm", 1e9))
SECONDS = (Unit("s", 1.0), Unit("ms", 1e3), Unit("µs", 1e6))


def unit_for(largest: float, units: tuple[Unit, ...], *, usual: str) -> Unit:
    """Return the unit in which the largest of some values reads best.

    The usual unit is kept from 0.01 to 9999 of it; else it is the largest that gives at least 1.

    Parameters
    ----------
    largest
        Largest size of the values, in SI.
    units
        Units to choose from, largest first.
    usual
        Name of the unit to keep where it will do; also the unit where all values are zero.
    """
    keep = next(unit for unit in units if unit.name == usual)
    if largest == 0 or not math.isfinite(largest) or 0.01 <= largest * keep.per_si < 1e4:
        return keep
    return next((unit for unit in units if largest * unit.per_si >= 1), units[-1])


_RAISED = str.maketrans("−0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def signed(value: float, decimals: int) -> str:
    """Return a number with its sign; in powers of ten where it would round to zero: −3×10⁻¹³."""
    if value == 0:
        return "0"
    if abs(value) >= 0.5 * 10**-decimals:
        return f"{value:+.{decimals}f}".replace("-", "−")
    mantissa, exponent = f"{value:+.0e}".replace("-", "−").split("e")
    power = exponent[0].replace("+", "") + exponent[1:].lstrip("0")
    return f"{mantissa}×10{power.translate(_RAISED)}"


def seconds(value_s: float) -> str:
    """Return a timestep as people write it: 1/240 s where it is such a fraction."""
    whole = round(1 / value_s) if value_s > 0 else 0
    if whole > 1 and math.isclose(whole * value_s, 1, rel_tol=1e-9):
        return f"1/{whole} s"
    return f"{value_s:.6g} s"

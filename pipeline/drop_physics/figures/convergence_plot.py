"""Plot how the error and its terms change with the timestep: log-log, with reference slopes.

A straight line of slope p is an error of order p. With damping the total against free fall is not
straight: the timestep's share falls, the damping's stays, and where they cancel it dips.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from drop_physics import colours
from drop_physics.errors import ScenarioError, check_suffix
from drop_physics.figures import style
from drop_physics.figures.ink import Ink
from drop_physics.figures.style import words
from drop_physics.messages import Message

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Float64 = NDArray[np.float64]

MOST_PANELS = 4
WIDTH_IN, HEAD_IN, ROW_IN = 8.0, 0.75, 3.9
"""Of the figure, of the space above the panels, and of one row of panels."""
LOWEST_M = 1e-9
"""Below a nanometre only a note is drawn: rounding is ten decades below the rest."""


@dataclass(frozen=True)
class Panel:
    """Runs that differ in the timestep only."""

    title: str
    timesteps_s: Float64
    """Coarse to fine, shape (n,)."""
    errors_m: dict[str, Float64]
    """`total` and its four terms, shape (n,) each."""
    cancelling_timestep_s: float | None


def check_plot(path: Path, *, timesteps: int, engines: bool = False) -> None:
    """Check that there is something to plot, before any work is done.

    Raises
    ------
    ScenarioError
        If the suffix is neither .png nor .svg, or there are neither two timesteps nor engines.
    """
    check_suffix("--plot", path, (".png", ".svg"))
    if timesteps < 2 and not engines:
        raise ScenarioError(
            "--plot shows errors over the timestep and needs two or more, got {timesteps}; "
            "try --timestep 1/240,1/480,1/960, or several engines",
            timesteps=timesteps,
        )


def plot_convergence(
    panels: Sequence[Panel],
    target: Path | BinaryIO,
    *,
    format: str,  # noqa: A002
    title: str,
    dark: bool = False,
) -> None:
    """Plot panels side by side, at most four; the same panels give the same bytes.

    Parameters
    ----------
    panels
        What to plot, at least one.
    target
        The file to write, or a stream.
    format
        `png`, or `svg` with its text as text.
    title
        What the errors are of.
    dark
        Whether it is for a dark page.
    """
    style.save(
        lambda ink: build_figure(panels, title=title, ink=ink), target, format=format, dark=dark
    )


def build_figure(panels: Sequence[Panel], *, title: str, ink: Ink) -> Figure:
    """Return the figure: one axes per panel, labelled with its title, all on the same scales.

    It is as wide as the plot of a drop, however many panels there are, so that its letters look
    equally large on a page.
    """
    shown = panels[:MOST_PANELS]
    columns = min(2, len(shown))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(WIDTH_IN, HEAD_IN + ROW_IN * rows), dpi=150)
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
    height_in = figure.get_figheight()
    figure.subplots_adjust(
        0.95 / WIDTH_IN,
        0.6 / height_in,
        1 - 1.0 / WIDTH_IN,
        1 - (HEAD_IN + 0.3) / height_in,
        wspace=0.47,
        hspace=0.38,
    )
    figure.text(0.02, 1 - 0.17 / height_in, words(title), size=15, weight="bold", va="top")
    hidden = len(panels) - len(shown)
    subtitle = words(
        "|simulated − free fall| and its terms; dashed: slope 1, an error of first order"
    )
    if hidden == 1:
        subtitle += words("; 1 more panel not shown")
    elif hidden:
        subtitle += words("; {hidden} more panels not shown", hidden=hidden)
    figure.text(0.02, 1 - 0.51 / height_in, subtitle, size=10.5, color=ink.faint, va="top")
    low, high = _limits_mm(shown)
    for axes in grid.flat[len(shown) :]:
        axes.remove()
    for axes, panel in zip(grid.flat, shown, strict=False):
        axes.set_label(panel.title)
        _draw(axes, panel, low, high, ink, most_ticks=6 if columns == 1 else 4)
    for axes in grid[:, 0]:
        axes.set_ylabel(words("|error| [mm]"))
    return figure


def _limits_mm(panels: Sequence[Panel]) -> tuple[float, float]:
    drawn = [
        abs(error)
        for panel in panels
        for errors in panel.errors_m.values()
        for error in errors
        if abs(error) >= LOWEST_M
    ]
    if not drawn:
        return 1e-6, 1.0
    return 10 ** (math.floor(math.log10(min(drawn) * 1e3)) - 0.3), max(drawn) * 1e3 * 2.5


def _draw(axes: Axes, panel: Panel, low: float, high: float, ink: Ink, *, most_ticks: int) -> None:
    steps, errors = panel.timesteps_s, panel.errors_m
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    margin = (steps[0] / steps[-1]) ** 0.08
    axes.set_xlim(steps[0] * margin, steps[-1] / margin)  # refining goes to the right
    axes.set_title(words(panel.title), size=11, loc="left", color=ink.text)
    _slopes(axes, steps, low, high, ink)
    ends: list[tuple[float, str, str]] = []
    notes = []
    for name, colour in ({"total": ink.text} | colours.TERMS).items():
        millimetres = np.abs(errors[name]) * 1e3
        if millimetres.max() < LOWEST_M * 1e3:
            if millimetres.max() > 0:
                most = style.signed(millimetres.max(), 0)[1:]
                notes.append(words("{name} at most {most} mm", name=Message(name), most=most))
            continue
        seen = np.where(millimetres >= low, millimetres, np.nan)
        is_total = name == "total"
        axes.plot(
            steps,
            seen,
            "o" if is_total else "o-",
            color=colour,
            lw=1.5,
            ms=9 if is_total else 5,
            label=name,
            zorder=2 if is_total else 3,
        )
        if is_total:
            between = np.geomspace(steps[0], steps[-1], 2000)
            axes.plot(between, _total_mm(panel, between), color=colour, lw=3, zorder=1.5)
        ends.append((float(millimetres[-1]), name, colour))
    _label_ends(axes, ends)
    if panel.cancelling_timestep_s is not None:
        _mark_cancelling(axes, panel.cancelling_timestep_s, ink)
    if notes:
        axes.text(
            0.03,
            0.03,
            "\n".join(notes),
            transform=axes.transAxes,
            size=9,
            color=ink.faint,
            bbox=_clear(ink),
        )
    axes.set_xlabel(words("timestep [s]"))
    axes.xaxis.set_major_locator(FixedLocator(list(steps[:: -(-len(steps) // most_ticks)])))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(
        FuncFormatter(lambda value, _: style.seconds(value).removesuffix(" s"))
    )
    axes.yaxis.set_major_locator(LogLocator(10, numticks=20))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(_plain))


def _plain(value: float, _: int) -> str:
    # A tick of 10⁻⁵ is computed as 9.999999999999999e-06.
    return np.format_float_positional(value, precision=3, fractional=False, trim="-")


def _total_mm(panel: Panel, timesteps_s: Float64) -> Float64:
    """Return |timestep + damping| [mm]: one is proportional to the timestep, the other constant."""
    slope = panel.errors_m["timestep"][-1] / panel.timesteps_s[-1]
    total_m: Float64 = slope * timesteps_s + panel.errors_m["damping"][-1]
    return np.abs(total_m) * 1e3


def _slopes(axes: Axes, steps: Float64, low: float, high: float, ink: Ink) -> None:
    """Draw faint lines of slope 1, a decade apart, behind everything."""
    decades = np.arange(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 3)
    wide = np.array([steps[0] * 1.5, steps[-1] / 1.5])
    for decade in decades:
        axes.plot(
            wide,
            10.0**decade * wide / steps[0],
            color=ink.faint,
            lw=0.6,
            ls=(0, (4, 4)),
            alpha=0.55,
            zorder=0.5,
            label="_slope",
        )


def _label_ends(axes: Axes, ends: list[tuple[float, str, str]]) -> None:
    """Name each curve at its right end, and keep the names apart."""
    low, high = np.log10(axes.get_ylim())
    apart, last = 0.052 * (high - low), -math.inf
    for value, name, colour in sorted(ends):
        place = max(math.log10(value), last + apart)
        last = place
        axes.annotate(
            words(name),
            (1.02, (place - low) / (high - low)),
            xycoords="axes fraction",
            color=colour,
            va="center",
            size=10,
            weight="bold" if name == "total" else "normal",
        )


def _mark_cancelling(axes: Axes, timestep_s: float, ink: Ink) -> None:
    first, last = axes.get_xlim()
    if not last < timestep_s < first:
        return
    axes.axvline(timestep_s, color=ink.faint, lw=0.9, ls=(0, (2, 2)), zorder=0.8)
    axes.annotate(
        words("timestep and damping\ncancel at 1/{steps:.0f} s", steps=1 / timestep_s),
        (timestep_s, 0.42),
        xycoords=axes.get_xaxis_transform(),
        xytext=(7, 0),
        textcoords="offset points",
        size=9,
        color=ink.faint,
        bbox=_clear(ink),
    )


def _clear(ink: Ink) -> dict[str, object]:
    """Return the box that keeps lines from running through a text."""
    return {"facecolor": ink.page, "edgecolor": "none", "pad": 1.0}

"""Plot how the error and its terms change with the timestep: log-log, with reference slopes.

A straight line of slope p is an error of order p. With damping the total against free fall is not
straight: the timestep's share falls, the damping's stays, and where they cancel it dips.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator

from drop_physics import colours
from drop_physics.arrays import Float64
from drop_physics.errors import ScenarioError, check_suffix
from drop_physics.figures import style
from drop_physics.figures.theme import Theme
from drop_physics.messages import Message

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MOST_PANELS = 4
ROW_IN = 3.9
"""Height of a row of panels [inch]."""
LOWEST_M = 1e-9
"""Least error that has a curve, 1 nm: rounding, ten decades below the rest, has a note."""


@dataclass(frozen=True)
class Refinement:
    """Errors of runs that differ in the timestep only."""

    title: str
    timesteps_s: Float64
    """The timesteps from coarse to fine, shape (n,)."""
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


def build_figure(refinements: Sequence[Refinement], title: str, theme: Theme) -> Figure:
    """Return the figure: a panel per refinement, at most four, all on the same scales.

    `title` is what the errors are of; the panels are labelled with their own.
    """
    shown = refinements[:MOST_PANELS]
    columns = min(2, len(shown))
    rows = -(-len(shown) // columns)
    subtitle = style.label(
        "|simulated − free fall| and its terms; dashed: slope 1, an error of first order"
    )
    hidden = len(refinements) - len(shown)
    if hidden == 1:
        subtitle += style.label("; 1 more panel not shown")
    elif hidden:
        subtitle += style.label("; {hidden} more panels not shown", hidden=hidden)
    figure = style.figure_of(title, [subtitle], ROW_IN * rows, theme)
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
    low, high = _limits_mm(shown)
    for axes in grid.flat[len(shown) :]:
        axes.remove()
    for axes, each in zip(grid.flat, shown, strict=False):
        axes.set_label(each.title)
        axes.set_title(style.lines_of([each.title], 66 // columns, 2), loc="left")
        _draw(axes, each, low, high, theme, most_ticks=6 if columns == 1 else 4)
    for axes in grid[:, 0]:
        axes.set_ylabel(style.label("|error| [mm]"))
    return style.laid_out(figure)


def _limits_mm(refinements: Sequence[Refinement]) -> tuple[float, float]:
    drawn = [
        abs(error)
        for each in refinements
        for errors in each.errors_m.values()
        for error in errors
        if abs(error) >= LOWEST_M
    ]
    if not drawn:
        return 1e-6, 1.0
    return 10 ** (math.floor(math.log10(min(drawn) * 1e3)) - 0.3), max(drawn) * 1e3 * 2.5


def _draw(
    axes: Axes, refinement: Refinement, low: float, high: float, theme: Theme, *, most_ticks: int
) -> None:
    steps, errors = refinement.timesteps_s, refinement.errors_m
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    margin = (steps[0] / steps[-1]) ** 0.08
    axes.set_xlim(steps[0] * margin, steps[-1] / margin)  # refining goes to the right
    _slopes(axes, steps, low, high, theme)
    ends: list[tuple[str, float, str]] = []
    notes = []
    for name, colour in ({"total": theme.text} | colours.TERMS).items():
        millimetres = np.abs(errors[name]) * 1e3
        if millimetres.max() < LOWEST_M * 1e3:
            if millimetres.max() > 0:
                most = style.signed(millimetres.max(), 0)[1:]
                notes.append(style.label("{name} at most {most} mm", name=Message(name), most=most))
            continue
        is_total = name == "total"
        axes.plot(
            steps,
            np.where(millimetres >= low, millimetres, np.nan),
            "o" if is_total else "o-",
            color=colour,
            lw=1.5,
            ms=9 if is_total else 5,
            label=name,
            zorder=2 if is_total else 3,
        )
        if is_total:
            between = np.geomspace(steps[0], steps[-1], 2000)
            axes.plot(between, _total_mm(refinement, between), color=colour, lw=3, zorder=1.5)
        ends.append((Message(name), float(millimetres[-1]), colour))
    style.name_curves(axes, ends, columns=21, size=10)
    if refinement.cancelling_timestep_s is not None:
        _mark_cancelling(axes, refinement.cancelling_timestep_s, theme)
    if notes:
        axes.text(
            0.03,
            0.03,
            "\n".join(notes),
            transform=axes.transAxes,
            size=9,
            color=theme.faint,
            bbox=_clear(theme),
        )
    axes.set_xlabel(style.label("timestep [s]"))
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


def _total_mm(refinement: Refinement, timesteps_s: Float64) -> Float64:
    """Return |timestep + damping| [mm]: one is proportional to the timestep, the other constant."""
    slope = refinement.errors_m["timestep"][-1] / refinement.timesteps_s[-1]
    total_m: Float64 = slope * timesteps_s + refinement.errors_m["damping"][-1]
    return np.abs(total_m) * 1e3


def _slopes(axes: Axes, steps: Float64, low: float, high: float, theme: Theme) -> None:
    """Draw faint lines of slope 1, a decade apart, behind everything."""
    wide = np.array([steps[0] * 1.5, steps[-1] / 1.5])
    for decade in np.arange(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 3):
        axes.plot(
            wide,
            10.0**decade * wide / steps[0],
            color=theme.faint,
            lw=0.6,
            ls=(0, (4, 4)),
            alpha=0.55,
            zorder=0.5,
            label="_slope",
        )


def _mark_cancelling(axes: Axes, timestep_s: float, theme: Theme) -> None:
    first, last = axes.get_xlim()
    if not last < timestep_s < first:
        return
    axes.axvline(timestep_s, color=theme.faint, lw=0.9, ls=(0, (2, 2)), zorder=0.8)
    axes.annotate(
        style.label("timestep and damping\ncancel at 1/{steps:.0f} s", steps=1 / timestep_s),
        (timestep_s, 0.42),
        xycoords=axes.get_xaxis_transform(),
        xytext=(7, 0),
        textcoords="offset points",
        size=9,
        color=theme.faint,
        bbox=_clear(theme),
    )


def _clear(theme: Theme) -> dict[str, object]:
    """Return the box that keeps lines from running through a text."""
    return {"facecolor": theme.page, "edgecolor": "none", "pad": 1.0}

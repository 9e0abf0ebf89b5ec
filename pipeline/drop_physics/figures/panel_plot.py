"""Draws the plot of a run: a title, lines that explain it, and panels on a common time axis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from drop_physics import colours
from drop_physics.arrays import Float64
from drop_physics.figures import style
from drop_physics.figures.plot import Curve, Inset, Panel, Plot
from drop_physics.figures.style import Unit
from drop_physics.figures.theme import Theme
from drop_physics.messages import Message

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PANEL_IN, GAP_IN, FOOT_IN = 1.55, 0.42, 0.65
"""Height of a panel, of the gap above it, and of the space below the last panel [inch]."""
BESIDE, BESIDE_TITLE, BESIDE_LINE = 2, 50, 0.055
"""Number of panels in a plot beside a video, characters in a title line, and the line's share of
the height."""
OPACITY = 0.75
"""Opacity of stacked areas."""
WIDTHS = {"line": 1.8, "broad": 3.6, "wide": 6.0, "dashed": 1.5}
"""Line width of a curve for each style [points]."""
INSET, INSET_TALLER = (0.62, 0.36, 0.36, 0.5), 1.5
"""Position of an inset, as shares of its panel, and the factor by which that panel is taller."""
USUAL, TALLER = 98.0, 3.0
"""A percentile of a panel's values, and the multiple of it above which peaks are cut off."""
LEAST_SPAN = {"rad": 1e-3} | {unit.name: 1e-4 * unit.per_si for unit in style.METRES}
"""Least range of an axis of positions, by unit: less than 1 mrad or 0.1 mm counts as no motion."""
SCALED = tuple({unit.name: unit for unit in units} for units in (style.METRES, style.JOULES))
"""Units that may be replaced by a larger or smaller unit of the same quantity."""
LEAST_SHARE = 1e-5
"""Smallest range of an axis, as a share of the largest value: tick labels have at most seven
digits."""


@dataclass(frozen=True)
class Letters:
    """Font sizes [points], and the line length of curve names."""

    title: float
    label: float
    tick: float
    name: float
    name_columns: int
    """Characters in a line of a curve's name."""


LARGE = Letters(title=11, label=11, tick=10, name=10, name_columns=21)
SMALL = Letters(title=9.5, label=9, tick=8.5, name=9, name_columns=12)


def build_figure(plot: Plot, theme: Theme) -> Figure:
    """Return the figure of a plot; its axes are labelled `panel 0` and so on."""
    panels_in = [PANEL_IN * (INSET_TALLER if panel.inset else 1) for panel in plot.panels]
    height_in = sum(panels_in) + GAP_IN * len(panels_in) + FOOT_IN * bool(panels_in)
    figure = style.figure_of(plot.title, plot.lines, height_in, theme)
    if plot.panels:
        _draw_panels(figure, plot.panels, theme, LARGE)
    return style.laid_out(figure)


def draw_beside(figure: Figure, plot: Plot, theme: Theme) -> tuple[list[Axes], Unit]:
    """Draw title and first panels into a small figure; return the axes, and the time unit."""
    title = style.lines_of([plot.title], BESIDE_TITLE, style.MOST_TITLE)
    figure.text(0.03, 0.97, title, size=10, weight="bold", va="top")
    style.head(figure, BESIDE_LINE * (title.count("\n") + 1.5))
    shown = [replace(panel, mark="", span_s=None, inset=None) for panel in plot.panels[:BESIDE]]
    axes, time = _draw_panels(figure, shown, theme, SMALL)
    style.laid_out(figure)
    return axes, time


def render(plot: Plot, format: str, dark: bool) -> bytes:  # noqa: A002
    """Return a plot for a light or a dark page as a `png` or `svg`."""
    return style.rendered(lambda theme: build_figure(plot, theme), format, dark=dark)


def _draw_panels(
    figure: Figure, panels: Sequence[Panel], theme: Theme, letters: Letters
) -> tuple[list[Axes], Unit]:
    """Draw panels one below the other; return their axes, and the time unit."""
    ends_s = [curve.times_s[-1:] for panel in panels for curve in panel.curves]
    end_s = float(np.concatenate(ends_s).max(initial=0.0))
    time = style.unit_for(end_s, style.SECONDS, usual="s")
    tall = [INSET_TALLER if panel.inset else 1.0 for panel in panels]
    axes = figure.subplots(len(panels), sharex=True, squeeze=False, height_ratios=tall)[:, 0]
    axes[-1].set_xlim(0, end_s * time.per_si or 1)
    axes[-1].set_xlabel(style.label("time [{unit}]", unit=time.name), size=letters.label)
    for number, (each, panel) in enumerate(zip(axes, panels, strict=True)):
        each.set_label(f"panel {number}")
        _draw(each, panel, time, theme, letters)
        if panel.inset is not None:
            _enlarge(each, panel, panel.inset, time, theme)
    return [*axes], time


def _draw(axes: Axes, panel: Panel, time: Unit, theme: Theme, letters: Letters) -> None:
    panel, mark = _readable(panel), f"{panel.mark}  " if panel.mark else ""
    title = f"{mark}{style.lines_of([panel.title], style.TITLE, 1)} [{panel.unit}]"
    axes.set_title(title, loc="left", size=letters.title, pad=5)
    axes.tick_params(labelsize=letters.tick)
    if panel.span_s is not None:
        first, last = (at * time.per_si for at in panel.span_s)
        axes.axvspan(first, last, color=theme.faint, alpha=0.13, lw=0)
    if panel.moment_s is not None:
        axes.axvline(panel.moment_s * time.per_si, color=theme.text, lw=1.2, zorder=3)
    if panel.zero:
        axes.axhline(0, color=theme.faint, lw=0.9, zorder=0.9)
    if panel.stacked:
        _stack(axes, panel.curves[1:], time)
    for order, curve in enumerate(panel.curves[:1] if panel.stacked else panel.curves):
        axes.plot(
            curve.times_s * time.per_si,
            curve.values,
            color=_colour(curve, theme),
            lw=WIDTHS[curve.look],
            linestyle=style.DASHED if curve.look == "dashed" else "-",
            marker=None if len(curve.times_s) > 1 else "o",
            markersize=4,
            solid_capstyle="butt",
            zorder=2 + 0.01 * order,
        )
    if panel.log:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"1e{math.log10(value):.0f}")
        axes.yaxis.set_minor_formatter(lambda *_: "")
    else:
        _limit(axes, panel, theme)
    known = [(curve, curve.values[np.isfinite(curve.values)]) for curve in panel.curves]
    style.name_curves(
        axes,
        [(curve.name, values[-1], _colour(curve, theme)) for curve, values in known if len(values)],
        columns=letters.name_columns,
        size=letters.name,
    )


def _enlarge(axes: Axes, panel: Panel, inset: Inset, time: Unit, theme: Theme) -> None:
    """Draw an inset that enlarges a short time of a panel, with samples as points."""
    inner = axes.inset_axes(INSET)
    shown = []
    for curve in panel.curves:
        within = (curve.times_s >= inset.first_s) & (curve.times_s <= inset.last_s)
        shown.append(replace(curve, times_s=curve.times_s[within], values=curve.values[within]))
    near = _readable(replace(panel, curves=shown, inset=None))
    for curve in near.curves:
        inner.plot(
            curve.times_s * time.per_si,
            curve.values,
            color=_colour(curve, theme),
            lw=0.8 * WIDTHS[curve.look],
            marker="o" if curve.look == "line" else None,
            markersize=3,
            solid_capstyle="butt",
        )
    title = f"{style.label(inset.title)} [{near.unit}]"
    inner.set_title(title, loc="left", size=9, pad=3, color=theme.faint)
    inner.tick_params(labelsize=8)


def _stack(axes: Axes, curves: Sequence[Curve], time: Unit) -> None:
    """Draw curves as stacked areas: negative ones down from zero, the others up."""
    for edges in _edges(curves):
        inner = np.zeros(edges.shape[1])
        for curve, edge in zip(curves, edges, strict=True):
            axes.fill_between(
                curve.times_s * time.per_si, inner, edge, color=curve.colour, alpha=OPACITY, lw=0
            )
            inner = edge


def _edges(curves: Sequence[Curve]) -> Iterator[Float64]:
    """Yield the outer edges of the areas below zero, then of those above, one row per curve."""
    values = np.stack([curve.values for curve in curves])
    for sign in (-1, 1):
        yield np.cumsum(np.where(sign * values < 0, 0.0, values), axis=0)


def _readable(panel: Panel) -> Panel:
    """Convert a panel of lengths or energies to the unit that suits the largest value."""
    units = next((each for each in SCALED if panel.unit in each), None)
    if units is None:
        return panel
    largest = max(float(np.nanmax(np.abs(curve.values), initial=0.0)) for curve in panel.curves)
    own = units[panel.unit]
    unit = style.unit_for(largest / own.per_si, (*units.values(),), usual=panel.unit)
    scale = unit.per_si / own.per_si
    curves = [replace(curve, values=curve.values * scale) for curve in panel.curves]
    return replace(panel, unit=unit.name, curves=curves)


def _colour(curve: Curve, theme: Theme) -> str:
    return theme.simulated if curve.colour == colours.SIMULATED else curve.colour or theme.text


def _limit(axes: Axes, panel: Panel, theme: Theme) -> None:
    """Fit the axis to its curves; cut off far higher peaks, with a note in the panel."""
    stacked = [edges[-1] for edges in _edges(panel.curves[1:])] if panel.stacked else []
    values = np.concatenate([*(curve.values for curve in panel.curves), *stacked])
    values = values[np.isfinite(values)]
    if not len(values):
        return
    low, high = float(values.min()), float(values.max())
    usual = [float(np.percentile(values, at)) for at in (100 - USUAL, USUAL)]
    room = max(usual[1], 0.0) - min(usual[0], 0.0) or 1.0
    cut = [end for end in (low, high) if abs(end) > TALLER * room]
    bottom, top = (max(low, -1.5 * room), min(high, 1.5 * room)) if cut else (low, high)
    if panel.zero:
        bottom, top = min(bottom, 0.0), max(top, 0.0)
    else:
        least = max(LEAST_SPAN.get(panel.unit, 0.0), LEAST_SHARE * max(-bottom, top))
        lacks = max(least - (top - bottom), 0.0) / 2
        bottom, top = bottom - lacks, top + lacks
    margin = 0.08 * ((top - bottom) or 1.0)
    axes.set_ylim(bottom - margin * (bottom < 0 or not panel.zero), top + margin)
    if cut:
        most = max(cut, key=abs)
        said = Message("peak of {peak:.3g} {unit} cut off", peak=most, unit=panel.unit)
        axes.annotate(
            style.label(said),
            (1, 1),
            xycoords="axes fraction",
            xytext=(-2, -2),
            textcoords="offset points",
            ha="right",
            va="top",
            size=9,
            color=theme.faint,
            zorder=4,
            bbox={"facecolor": theme.page, "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
        )

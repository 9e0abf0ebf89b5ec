"""Plot what happened: a title, what it means, and below a few panels on one time axis."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from drop_physics import colours
from drop_physics.figures import style
from drop_physics.figures.ink import Ink
from drop_physics.figures.story import Curve, Detail, Panel, Story
from drop_physics.figures.style import Unit
from drop_physics.messages import Message, wrapped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_IN, HEAD_IN, FOOT_IN = 8.0, 0.3, 0.55
"""Of the figure; above and below its panels."""
PANEL_IN, GAP_IN, LINE_IN = 1.55, 0.42, 0.24
LEFT, RIGHT = 0.085, 0.79
"""Ends of the panels, as shares of the width: right of them the curves' names are."""
TITLE, LINE = 68, 98
"""Characters that fit in a line of the title, and in one below it."""
MOST_TITLE, MOST_LINES = 2, 5
NAME = 21
"""Characters of a curve's name that fit beside a panel."""
APART = 0.135
"""Least distance of two names, as a share of a panel's height."""
BESIDE, BESIDE_TITLE, BESIDE_NAME = 2, 50, 12
"""Panels beside a film, and characters in a line of its title and of a curve's name."""
OPACITY = 0.75
WIDTHS = {"line": 1.8, "broad": 3.6, "wide": 6.0, "dashed": 1.5}
"""Of curves [points]."""
INSET, INSET_TALLER = (0.62, 0.36, 0.36, 0.5), 1.5
"""Place of what is enlarged, as shares of its panel, which is so many times taller."""
USUAL, TALLER = 98.0, 3.0
"""Peaks over TALLER times this percentile of a panel are cut off."""


def build_story(story: Story, ink: Ink) -> Figure:
    """Return the figure of a story; its axes are labelled `panel 0` and so on."""
    title = _wrapped([story.title], TITLE, MOST_TITLE)
    lines = _wrapped(story.lines, LINE, MOST_LINES)
    head_in = HEAD_IN + 1.2 * LINE_IN * len(title) + LINE_IN * 0.8 * len(lines) + GAP_IN
    count = len(story.panels)
    tall = [INSET_TALLER if panel.enlarged else 1.0 for panel in story.panels]
    height_in = head_in + sum(tall) * PANEL_IN + max(0, count - 1) * GAP_IN + FOOT_IN
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=150)
    at = 1 - 0.6 * HEAD_IN / height_in
    figure.text(0.02, at, "\n".join(title), size=14, weight="bold", va="top", linespacing=1.25)
    at -= 1.3 * LINE_IN * len(title) / height_in + 0.06 / height_in
    figure.text(0.02, at, "\n".join(lines), size=10, color=ink.faint, va="top", linespacing=1.3)
    if not story.panels:
        return figure
    end_s = max(
        (
            float(curve.times_s[-1])
            for panel in story.panels
            for curve in panel.curves
            if len(curve.times_s)
        ),
        default=0.0,
    )
    time = style.unit_for(end_s, style.SECONDS, usual="s")
    axes = figure.subplots(count, 1, sharex=True, squeeze=False, height_ratios=tall)[:, 0]
    figure.subplots_adjust(
        LEFT,
        FOOT_IN / height_in,
        RIGHT,
        1 - head_in / height_in,
        hspace=GAP_IN / (PANEL_IN * sum(tall) / count),
    )
    axes[-1].set_xlim(0, end_s * time.per_si or 1)
    axes[-1].set_xlabel(style.words("time [{unit}]", unit=time.name))
    for number, (each, panel) in enumerate(zip(axes, story.panels, strict=True)):
        each.set_label(f"panel {number}")
        _draw(each, panel, time, ink)
        if panel.enlarged is not None:
            _enlarge(each, panel, panel.enlarged, time, ink)
    figure.align_ylabels(axes)
    return figure


def draw_beside(figure: Figure, story: Story, ink: Ink) -> tuple[list[Axes], Unit]:
    """Draw title and first panels into a small figure; return them, and the unit of time."""
    shown = story.panels[:BESIDE]
    title = _wrapped([story.title], BESIDE_TITLE, MOST_TITLE)
    figure.text(0.03, 0.97, "\n".join(title), size=10, weight="bold", va="top")
    end_s = max(float(curve.times_s[-1]) for panel in shown for curve in panel.curves)
    time = style.unit_for(end_s, style.SECONDS, usual="s")
    axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    figure.subplots_adjust(0.12, 0.12, 0.8, 0.8, hspace=0.35)
    axes[-1].set_xlim(0, end_s * time.per_si or 1)
    axes[-1].set_xlabel(style.words("time [{unit}]", unit=time.name), size=9)
    for each, panel in zip(axes, shown, strict=True):
        _draw(each, replace(panel, mark="", span_s=None), time, ink, name=BESIDE_NAME, size=9.0)
        each.set_title(each.get_title(loc="left"), loc="left", size=9.5, pad=4, color=ink.text)
        each.tick_params(labelsize=8.5)
    return [*axes], time


def told_story(story: Story, format: str, dark: bool) -> bytes:  # noqa: A002
    """Return the plot of a story as the bytes of a `png` or `svg` for a light or a dark page."""
    stream = io.BytesIO()
    style.save(lambda ink: build_story(story, ink), stream, format=format, dark=dark)
    return stream.getvalue()


def _wrapped(texts: Sequence[str], width: int, most: int) -> list[str]:
    lines = [line for text in texts for line in wrapped(style.words(text), width)]
    return [*lines[: most - 1], lines[most - 1] + " …"] if len(lines) > most else lines


def _draw(
    axes: Axes, panel: Panel, time: Unit, ink: Ink, *, name: int = NAME, size: float = 10.0
) -> None:
    """Draw a panel; a line of a curve's name has `name` characters of a `size` [points]."""
    panel, mark = _readable(panel), f"{panel.mark}  " if panel.mark else ""
    axes.set_title(
        f"{mark}{style.words(panel.title)} [{panel.unit}]",
        loc="left",
        size=11,
        pad=5,
        color=ink.text,
    )
    if panel.span_s is not None:
        first, last = (at * time.per_si for at in panel.span_s)
        axes.axvspan(first, last, color=ink.faint, alpha=0.13, lw=0)
    if panel.zero:
        axes.axhline(0, color=ink.faint, lw=0.9, zorder=0.9)
    if panel.stacked:
        _stack(axes, panel.curves[1:], time)
    for order, curve in enumerate(panel.curves[:1] if panel.stacked else panel.curves):
        thin = len(curve.times_s) > 1
        axes.plot(
            curve.times_s * time.per_si,
            curve.values,
            color=_colour(curve, ink),
            lw=WIDTHS[curve.look],
            linestyle=style.DASHED if curve.look == "dashed" else "-",
            marker=None if thin else "o",
            markersize=4,
            solid_capstyle="butt",
            zorder=2 + 0.01 * order,
        )
    if panel.log:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"1e{math.log10(value):.0f}")
        axes.yaxis.set_minor_formatter(lambda *_: "")
    else:
        _limit(axes, panel, ink)
    _name(axes, panel.curves, ink, name, size)


def _enlarge(axes: Axes, panel: Panel, detail: Detail, time: Unit, ink: Ink) -> None:
    """Draw a short time of a panel once more, in its corner, with each sample as a point."""
    inner = axes.inset_axes(INSET)
    shown = []
    for curve in panel.curves:
        within = (curve.times_s >= detail.first_s) & (curve.times_s <= detail.last_s)
        shown.append(replace(curve, times_s=curve.times_s[within], values=curve.values[within]))
    near = _readable(replace(panel, curves=shown, enlarged=None))
    for curve in near.curves:
        thin = curve.look == "line"
        inner.plot(
            curve.times_s * time.per_si,
            curve.values,
            color=_colour(curve, ink),
            lw=0.8 * WIDTHS[curve.look],
            marker="o" if thin else None,
            markersize=3,
            solid_capstyle="butt",
        )
    inner.set_title(
        f"{style.words(detail.title)} [{near.unit}]", loc="left", size=9, pad=3, color=ink.faint
    )
    inner.tick_params(labelsize=8)


def _stack(axes: Axes, curves: Sequence[Curve], time: Unit) -> None:
    """Draw curves over the same samples as areas: what is negative down from zero, the rest up."""
    for edges in _edges(curves):
        inner = np.zeros(edges.shape[1])
        for curve, edge in zip(curves, edges, strict=True):
            axes.fill_between(
                curve.times_s * time.per_si, inner, edge, color=curve.colour, alpha=OPACITY, lw=0
            )
            inner = edge


def _edges(curves: Sequence[Curve]) -> Iterator[NDArray[np.float64]]:
    """Yield the outer edges of the areas below zero, then of those above, a row for each curve."""
    values = np.stack([curve.values for curve in curves])
    for sign in (-1, 1):
        yield np.cumsum(np.where(sign * values < 0, 0.0, values), axis=0)


def _readable(panel: Panel) -> Panel:
    """Return a panel of lengths in the unit in which the largest reads best."""
    units = {unit.name: unit.per_si for unit in style.METRES}
    if panel.unit not in units:
        return panel
    largest = max(float(np.nanmax(np.abs(curve.values), initial=0.0)) for curve in panel.curves)
    unit = style.unit_for(largest / units[panel.unit], style.METRES, usual=panel.unit)
    scale = unit.per_si / units[panel.unit]
    curves = [replace(curve, values=curve.values * scale) for curve in panel.curves]
    return replace(panel, unit=unit.name, curves=curves)


def _colour(curve: Curve, ink: Ink) -> str:
    return ink.simulated if curve.colour == colours.SIMULATED else curve.colour or ink.text


def _limit(axes: Axes, panel: Panel, ink: Ink) -> None:
    """Fit the panel to its curves; peaks far above all else are cut off, and this is said."""
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
    margin = 0.08 * ((top - bottom) or max(abs(top), 1e-3))
    axes.set_ylim(bottom - margin * (bottom < 0 or not panel.zero), top + margin)
    if cut:
        most = max(cut, key=abs)
        said = Message("peak of {peak:.3g} {unit} cut off", peak=most, unit=panel.unit)
        axes.annotate(
            style.words(said),
            (1, 1),
            xycoords="axes fraction",
            xytext=(-2, -2),
            textcoords="offset points",
            ha="right",
            va="top",
            size=9,
            color=ink.faint,
            zorder=4,
            bbox={"facecolor": ink.page, "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
        )


def _name(axes: Axes, curves: Sequence[Curve], ink: Ink, width: int, size: float) -> None:
    """Write the curves' names beside their ends, in their colours."""
    ends = []
    for curve in curves:
        known = curve.values[np.isfinite(curve.values)]
        if len(known):
            at = axes.transData.transform((0.0, float(known[-1])))
            end = float(axes.transAxes.inverted().transform(at)[1])
            ends.append((min(max(end, 0.0), 1.0), curve))
    ends.sort(key=lambda each: each[0])
    for place, (_, curve) in zip(_spread([end for end, _ in ends]), ends, strict=True):
        axes.annotate(
            "\n".join(_wrapped([curve.name], width, 2 * NAME // width)),
            (1, place),
            xycoords="axes fraction",
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            size=size,
            color=_colour(curve, ink),
            annotation_clip=False,
            linespacing=0.95,
        )


def _spread(ends: Sequence[float]) -> Iterator[float]:
    """Yield ascending places near these, far enough apart to be read."""
    places: list[float] = []
    for end in ends:
        places.append(max(end, places[-1] + APART) if places else end)
    for number, place in enumerate(places):
        yield min(place, 1.0 - APART * (len(places) - 1 - number))

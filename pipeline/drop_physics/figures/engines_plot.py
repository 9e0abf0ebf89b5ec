"""Plot the same drop in several engines: the falls, and what each does on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from drop_physics.arrays import Float64
from drop_physics.figures import style
from drop_physics.figures.theme import Theme

if TYPE_CHECKING:
    from matplotlib.axes import Axes


HEIGHT_IN = 3.4
AFTER_S, BEFORE_S = 0.1, 0.01
"""Time that is drawn after the first impact, and before it [s]."""


@dataclass(frozen=True)
class EngineFall:
    """The fall of a run."""

    label: str
    colour: str
    time_s: Float64
    """Time of each sample, shape (n,)."""
    height_m: Float64
    """Height of the centre, shape (n,)."""
    floor_height_m: float | None
    """Height of the centre at which the body touches the floor; None without a floor."""


def build_figure(falls: Sequence[EngineFall], theme: Theme) -> Figure:
    """Return the figure: the falls, and right of them the first impact if there is a floor."""
    figure = style.figure_of(style.label("The same drop in several engines"), [], HEIGHT_IN, theme)
    landing = any(each.floor_height_m is not None for each in falls)
    panels = figure.subplots(1, 1 + landing, squeeze=False)[0]
    panels[0].set_title(style.label("height of the centre [{unit}]", unit="m"), loc="left")
    panels[0].set_xlabel(style.label("time [{unit}]", unit="s"))
    for each in falls:
        panels[0].plot(each.time_s, each.height_m, color=each.colour, lw=1.6)
    ends_m = [each.height_m[-1] for each in falls]
    if landing:
        ends_m = _draw_landing(panels[1], falls, theme)
    names = [(each.label, end, each.colour) for each, end in zip(falls, ends_m, strict=True)]
    style.name_curves(panels[-1], names, columns=21, size=10)
    return style.laid_out(figure)


def _draw_landing(axes: Axes, falls: Sequence[EngineFall], theme: Theme) -> list[float]:
    """Draw heights above the floor around the first impact, and return the last of each."""
    axes.set_title(style.label("above the floor, around the first impact [mm]"), loc="left")
    axes.set_xlabel(style.label("time [{unit}]", unit="ms"))
    axes.axhline(0, color=theme.faint, lw=0.9, zorder=0.8)
    lands_s = []
    above_mm = [1e3 * (each.height_m - (each.floor_height_m or 0.0)) for each in falls]
    for each, above in zip(falls, above_mm, strict=True):
        if each.floor_height_m is not None:
            down = np.flatnonzero(above <= 0)
            # An engine that looks ahead never gets there: then where it first turns.
            turns = np.flatnonzero(np.diff(above) > 0)
            lands_s += each.time_s[down[:1] if len(down) else turns[:1]].tolist()
            axes.plot(each.time_s * 1e3, above, "o-", ms=2.5, lw=1.3, color=each.colour)
    if not lands_s:
        return [above[-1] for above in above_mm]
    first_s, last_s = min(lands_s), min(lands_s) + AFTER_S
    axes.set_xlim((first_s - BEFORE_S) * 1e3, last_s * 1e3)
    shown = [
        above[(each.time_s >= first_s) & (each.time_s <= last_s)]
        for each, above in zip(falls, above_mm, strict=True)
    ]
    within = np.concatenate(
        [mm for each, mm in zip(falls, shown, strict=True) if each.floor_height_m is not None]
    )
    margin = max(1.0, 0.08 * np.ptp(within))
    axes.set_ylim(within.min() - margin, within.max() + margin)
    return [mm[-1] for mm in shown]

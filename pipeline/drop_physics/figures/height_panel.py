"""The upper panel: what happened, beside theory; and the impact, enlarged."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drop_physics import colours
from drop_physics.figures.style import (
    FEW_POINTS,
    METRES,
    SECONDS,
    Ink,
    Place,
    Unit,
    mark_time,
    thinned,
    unit_for,
    words,
    write_clear,
)
from drop_physics.messages import Message

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes

CURVES = {  # widest first: each is drawn on the one before and leaves its edges visible
    "free_fall": (Message("free fall"), colours.FREE_FALL, 6.5),
    "damped_fall": (Message("damped fall"), colours.DAMPED_FALL, 4.0),
    "simulated": (Message("simulated"), colours.SIMULATED, 1.6),
}
Float64 = NDArray[np.float64]


def draw_heights(
    axes: Axes,
    table: pl.DataFrame,
    *,
    impact_s: float | None,
    rest_m: float | None,
    time: Unit,
    ink: Ink,
) -> None:
    """Draw simulated and theoretical height, and point out impact and rest.

    Parameters
    ----------
    axes
        Where to draw; its limits in time are set.
    table
        One row per sample, see `plot.build_figure`.
    impact_s, rest_m
        When the body meets the floor [s] and where it comes to lie [m], if it does.
    time
        The unit of the time axis.
    ink
        The colours of all that is not data.
    """
    lowest, highest = _reach(table)
    bottom = min(0.0, lowest)
    room = (highest - bottom) or 1.0
    unit = unit_for(max(highest, -bottom), METRES, usual="m")
    drawn = thinned(table)
    _draw_curves(axes, drawn, drawn["time_s"].to_numpy() * time.per_si, unit, ink)
    top = highest + 0.09 * room
    axes.set_ylim((bottom - 0.06 * room * (bottom < 0)) * unit.per_si, top * unit.per_si)
    axes.set_ylabel(words("height of the centre [{unit}]", unit=unit.name))
    axes.tick_params(bottom=False)
    high = Place((1, 1), ("axes fraction", "axes fraction"), (0, 1), "right")
    if impact_s is not None:
        mark_time(axes, impact_s, time, ink)
        late = impact_s * time.per_si > 0.6 * axes.get_xlim()[1]
        left = Place((impact_s * time.per_si, 1), ("data", "axes fraction"), (-5, 1), "right")
        right = replace(left, offset=(5, 1), align="left")
        impact = words("impact at {at:.4g} {unit}", at=impact_s * time.per_si, unit=time.name)
        write_clear(axes, impact, [left, right] if late else [right, left], ink)
        high = replace(left, offset=(-5, -14))  # below these words
    if rest_m is not None:
        rest = unit_for(abs(rest_m), METRES, usual="mm")
        low = Place((1, rest_m * unit.per_si), ("axes fraction", "data"), (0, 6), "right", "bottom")
        lower = replace(low, offset=(0, -6), above="top")
        rests = words("rests at {height:.3f} {unit}", height=rest_m * rest.per_si, unit=rest.name)
        write_clear(axes, rests, [low, lower, high], ink)


def _reach(table: pl.DataFrame) -> tuple[float, float]:
    """Return the lowest and highest of all curves [m]; theory may end before the table does."""
    values = table.select(f"{name}_m" for name in CURVES).to_numpy()
    return float(np.nanmin(values)), float(np.nanmax(values))


def _draw_curves(axes: Axes, table: pl.DataFrame, times: Float64, unit: Unit, ink: Ink) -> None:
    for name, (label, colour, width) in CURVES.items():
        if table[f"{name}_m"].is_null().all():
            continue
        dots = name == "simulated" and len(table) <= FEW_POINTS
        axes.plot(
            times,
            table[f"{name}_m"].to_numpy() * unit.per_si,
            color=ink.simulated if name == "simulated" else colour,
            linewidth=width,
            marker="o" if dots else None,
            markersize=4,
            label=words(label),
            solid_capstyle="butt",
        )


def stays_low(table: pl.DataFrame, impact_s: float) -> bool:
    """Return whether the space above the curve is free after the impact."""
    heights_m = table["simulated_m"].to_numpy()
    after = heights_m[table["time_s"].to_numpy() >= impact_s]
    return bool(len(after) and np.abs(after).max() < 0.2 * heights_m.max())


def enlarge_impact(axes: Axes, table: pl.DataFrame, impact_s: float, ink: Ink) -> None:
    """Show the impact in a panel of its own, sample by sample, time counted from it.

    Parameters
    ----------
    axes
        The panel whose empty upper right it takes.
    table
        One row per sample, at least two, see `plot.build_figure`.
    impact_s
        When the body meets the floor [s].
    ink
        The colours of all that is not data.
    """
    times_s = table["time_s"].to_numpy()
    reach_s = max(4 * float(times_s[1] - times_s[0]), 0.02 * impact_s)
    from_s, to_s = -reach_s, 2.5 * reach_s
    near = thinned(table.filter((table["time_s"] - impact_s).is_between(from_s, to_s)))
    lowest, highest = _reach(near)
    unit = unit_for(highest, METRES, usual="mm")
    time = unit_for(to_s, SECONDS, usual="ms")
    # Its numbers are on its left, and the line of the impact must not run through them.
    left = max(0.60, impact_s / float(times_s[-1]) + 0.12)
    panel = axes.inset_axes((left, 0.33, 1 - left, 0.50))
    panel.set_label("impact")
    panel.set_title(words("impact, enlarged"), size=10, color=ink.faint, loc="left", pad=5)
    _draw_curves(panel, near, (near["time_s"].to_numpy() - impact_s) * time.per_si, unit, ink)
    mark_time(panel, 0, time, ink)
    panel.set_xlim(from_s * time.per_si, to_s * time.per_si)
    panel.set_ylim(min(0, lowest * 1.05) * unit.per_si, highest * 1.05 * unit.per_si)
    panel.tick_params(labelsize=9)
    panel.set_xlabel(words("time from impact [{unit}]", unit=time.name), size=9, labelpad=2)
    panel.set_ylabel(words("height [{unit}]", unit=unit.name), size=9, labelpad=2)

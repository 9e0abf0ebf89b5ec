"""The lower panel: the error, stacked from its terms, and one moment of it as a sum."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from drop_physics import colours
from drop_physics.figures.style import (
    FEW_POINTS,
    METRES,
    Ink,
    Unit,
    decimals_for,
    signed,
    thinned,
    unit_for,
    words,
)

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes

COLUMNS = [f"{name}_m" for name in colours.TERMS]
OPACITY = 0.75
NOTHING_M = 1e-12
"""Errors below this are rounding, and get no axis of their own."""


def draw_terms(axes: Axes, explained: pl.DataFrame, time: Unit, ink: Ink) -> Unit:
    """Stack the terms, negative ones down and positive ones up from zero, under their sum.

    Parameters
    ----------
    axes
        Where to draw; its limits in time are set.
    explained
        One row per sample that has terms, `COLUMNS` [m] and `time_s`; may be empty.
    time
        The unit of the time axis.
    ink
        The colours of all that is not data.

    Returns
    -------
    The unit of the error axis.
    """
    largest = float(np.abs(explained.select(COLUMNS).to_numpy().astype(float)).max(initial=0))
    unit = _unit_of_error(largest, usual="mm")
    axes.set_ylabel(words("simulated − free fall [{unit}]", unit=unit.name))
    if largest < NOTHING_M:
        axes.set_ylim(-1, 1)
    if not len(explained):
        why = words("no theory covers these samples")
        axes.text(0.5, 0.6, why, transform=axes.transAxes, ha="center", color=ink.faint)
        axes.set_yticks([])
        return unit
    drawn = thinned(explained)
    times = drawn["time_s"].to_numpy() * time.per_si
    terms = drawn.select(COLUMNS).to_numpy() * unit.per_si  # (samples, terms)
    for sign in (-1, 1):
        outer = np.cumsum(np.where(sign * terms > 0, terms, 0), axis=1)
        inner = np.zeros(len(times))
        for edge, (name, colour) in zip(outer.T, colours.TERMS.items(), strict=True):
            axes.fill_between(times, inner, edge, color=colour, alpha=OPACITY, lw=0, label=name)
            inner = edge
    axes.hlines(0, 0, times[-1], color=ink.faint, linewidth=0.9)
    marker = "o" if len(times) <= FEW_POINTS else None
    total = terms.sum(axis=1)
    axes.plot(times, total, color=ink.text, lw=2.4, marker=marker, markersize=4, label="total")
    return unit


def _unit_of_error(largest_m: float, *, usual: str) -> Unit:
    return unit_for(largest_m if largest_m >= NOTHING_M else 0.0, METRES, usual=usual)


def row_at(explained: pl.DataFrame, at_s: float | None) -> dict[str, float]:
    """Return the sample nearest to a time [s], or the last one."""
    times_s = explained["time_s"].to_numpy()
    wanted_s = times_s[-1] if at_s is None else at_s
    row: dict[str, float] = explained.row(int(np.abs(times_s - wanted_s).argmin()), named=True)
    return row


def sum_up(
    axes: Axes, row: dict[str, float], time: Unit, unit: Unit, ink: Ink, *, left: float
) -> None:
    """Write one sample's terms as a sum, which is the stack's legend; a dot marks the sample.

    Parameters
    ----------
    axes
        The panel with the stack.
    row
        One sample: `COLUMNS` [m] and `time_s`.
    time, unit
        The units of the panel's axes.
    ink
        The colours of all that is not data.
    left
        Where the sum starts, in widths of the panel; from 1 on it is beside the panel.
    """
    terms_m = {name: row[f"{name}_m"] for name in colours.TERMS}
    total_m = math.fsum(terms_m.values())
    at = row["time_s"] * time.per_si
    lowest, highest = (math.fsum(f(0, m) for m in terms_m.values()) for f in (min, max))
    axes.vlines(at, lowest * unit.per_si, highest * unit.per_si, color=ink.page, linewidth=1.2)
    dot: dict[str, Any] = {
        "marker": "o",
        "color": ink.text,
        "markeredgecolor": ink.page,
        "markersize": 8,
    }
    axes.plot(at, total_m * unit.per_si, **dot, linestyle="", zorder=4, clip_on=False)

    # A moment tiny beside the whole stack, as early in a long fall, has a unit of its own.
    largest = max(map(abs, terms_m.values()))
    unit = _unit_of_error(largest, usual=unit.name)
    decimals = decimals_for(largest * unit.per_si) if largest >= NOTHING_M else 3
    wide = 0.36 if left < 1 else 0.41  # of the axes' width, which is less where a margin is left
    symbol, number, word = left + 0.03 * wide, left + 0.52 * wide, left + 0.57 * wide
    where: dict[str, Any] = {"transform": axes.transAxes, "clip_on": False}

    def write(x: float, y: float, text: str, **how: Any) -> None:  # noqa: ANN401
        axes.text(x, y, text, va="center", **where, **how)

    axes.plot(symbol, 0.94, **dot, linestyle="", **where)
    heading = words("at {at:.4g} {time}, in {unit}", at=at, time=time.name, unit=unit.name)
    write(symbol + 0.08 * wide, 0.94, heading, color=ink.faint)
    for line, (name, term_m) in enumerate(terms_m.items()):
        y = 0.82 - 0.105 * line
        square: dict[str, Any] = {
            "marker": "s",
            "color": colours.TERMS[name],
            "alpha": OPACITY,
            "markersize": 9,
        }
        axes.plot(symbol, y, **square, markeredgewidth=0, linestyle="", **where)
        write(number, y, signed(term_m * unit.per_si, decimals), ha="right")
        write(word, y, words(name))
    axes.plot([left, left + wide], [0.44, 0.44], color=ink.faint, linewidth=0.9, **where)
    axes.plot([left, left + 0.06 * wide], [0.37, 0.37], color=ink.text, linewidth=2.4, **where)
    write(number, 0.37, signed(total_m * unit.per_si, decimals), ha="right", weight="bold")
    write(word, 0.37, words("total"), weight="bold")

"""Plot the same drop in several engines: the falls, and what each does on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from drop_physics.figures import style
from drop_physics.figures.ink import Ink
from drop_physics.figures.style import words

Float64 = NDArray[np.float64]

AFTER_S, BEFORE_S = 0.1, 0.01
"""How much is drawn after an impact, and before it."""


@dataclass(frozen=True)
class Curve:
    """One run."""

    label: str
    colour: str
    time_s: Float64
    """Of each sample, shape (n,)."""
    height_m: Float64
    """Of the centre, shape (n,)."""
    floor_height_m: float | None
    """At which it touches the floor; None without a floor."""


def plot_engines(
    curves: Sequence[Curve],
    target: Path | BinaryIO,
    *,
    format: str,  # noqa: A002
    dark: bool = False,
) -> None:
    """Plot runs on top of each other; the same runs give the same bytes.

    Parameters
    ----------
    curves
        What to plot, at least one.
    target
        The file to write, or a stream.
    format
        `png`, or `svg` with its text as text.
    dark
        Whether it is for a dark page.
    """
    style.save(lambda ink: build_figure(curves, ink=ink), target, format=format, dark=dark)


def build_figure(curves: Sequence[Curve], *, ink: Ink) -> Figure:
    """Return the figure: the falls on the left, the floor after the first impact on the right."""
    figure = Figure(figsize=(8.0, 4.4), dpi=150)
    whole, floor = figure.subplots(1, 2)
    figure.subplots_adjust(0.09, 0.13, 0.985, 0.72, wspace=0.24)
    figure.text(
        0.02, 0.96, words("The same drop in several engines"), size=15, weight="bold", va="top"
    )
    for curve in curves:
        whole.plot(curve.time_s, curve.height_m, color=curve.colour, lw=1.6, label=curve.label)
    figure.legend(
        *whole.get_legend_handles_labels(),
        loc="upper left",
        bbox_to_anchor=(0.012, 0.9),
        ncols=min(5, len(curves)),
        handlelength=1.4,
        columnspacing=1.6,
    )
    whole.set_xlabel(words("time [{unit}]", unit="s"))
    whole.set_ylabel(words("height of the centre [{unit}]", unit="m"))
    _floor(floor, curves, ink)
    return figure


def _floor(axes: Axes, curves: Sequence[Curve], ink: Ink) -> None:
    """Draw how far the body is above the floor, around its first impact."""
    lands_s = []
    for curve in curves:
        if curve.floor_height_m is None:
            continue
        above_m = curve.height_m - curve.floor_height_m
        down = np.flatnonzero(above_m <= 0)
        # An engine that looks ahead never gets there: then where it first turns.
        turns = np.flatnonzero(np.diff(above_m) > 0)
        first = down[:1] if len(down) else turns[:1]
        lands_s += [float(curve.time_s[sample]) for sample in first]
        axes.plot(curve.time_s * 1e3, above_m * 1e3, "o-", ms=2.5, lw=1.3, color=curve.colour)
    axes.set_title(words("around the first impact"), size=11, loc="left", color=ink.text)
    axes.set_xlabel(words("time [{unit}]", unit="ms"))
    axes.set_ylabel(words("above the floor [mm]"))
    axes.axhline(0, color=ink.faint, lw=0.9, zorder=0.8)
    if not lands_s:
        return
    first_s, last_s = min(lands_s) - BEFORE_S, min(lands_s) + AFTER_S
    axes.set_xlim(first_s * 1e3, last_s * 1e3)
    seen = np.concatenate(
        [
            curve.height_m[(curve.time_s >= first_s + BEFORE_S) & (curve.time_s <= last_s)]
            - (curve.floor_height_m or 0.0)
            for curve in curves
            if curve.floor_height_m is not None
        ]
    )
    low, high = float(seen.min()) * 1e3, float(seen.max()) * 1e3
    margin = max(1.0, 0.08 * (high - low))
    axes.set_ylim(low - margin, high + margin)

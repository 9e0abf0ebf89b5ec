"""Plot a drop: its height against theory, and below it the error, broken down.

The upper panel shows what happened. All curves lie within millimetres of each other there, so the
impact, where they part, is shown enlarged. The lower panel stacks the terms of the error, negative
ones below zero and positive ones above it, with their sum as a line.
"""

from __future__ import annotations

import io
import textwrap
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np
import polars as pl
from matplotlib.figure import Figure
from PIL import Image, PngImagePlugin

from drop_physics.figures import style
from drop_physics.figures.error_panel import COLUMNS, draw_terms, row_at, sum_up
from drop_physics.figures.facts import Facts as Facts
from drop_physics.figures.gif import MADE_BY_DROP
from drop_physics.figures.height_panel import CURVES, draw_heights, enlarge_impact, stays_low
from drop_physics.messages import Message

THEORY = ("free_fall_m", "damped_fall_m")
BOUNCE = 0.01
"""The smallest visible bounce, as a share of the largest height."""
LINE = 92
"""Characters of a subtitle that fit in a line."""


def facts_of(table: pl.DataFrame) -> Facts:
    """Return what a table alone shows: where it starts, meets the floor and rests.

    Parameters
    ----------
    table
        One row per sample, at least one, see `build_figure`.
    """
    heights_m, steps = table["simulated_m"], len(table) - 1
    subtitle: str = ""
    if steps:
        step = style.seconds(table["time_s"][1] - table["time_s"][0])
        subtitle = Message("{steps} steps of {step}", steps=steps, step=step)
        if steps == 1:
            subtitle = Message("1 step of {step}", step=step)
    return Facts(
        title=Message("Dropped from {height:.6g} m", height=heights_m[0]),
        subtitle=subtitle,
        at_s=0.3,
        impact_s=_crossing_s(table),
        rest_m=heights_m[-1] if table["phase"][-1] == "rest" else None,
    )


def plotted(
    table: pl.DataFrame,
    format: Literal["png", "svg"],  # noqa: A002
    facts: Facts,
    dark: bool,
) -> bytes:
    """Return a plot as the bytes of a file, see `plot_drop`."""
    stream = io.BytesIO()
    plot_drop(table, stream, format=format, facts=facts, dark=dark)
    return stream.getvalue()


def plot_drop(
    table: pl.DataFrame,
    target: Path | BinaryIO,
    *,
    format: Literal["png", "svg"],  # noqa: A002
    facts: Facts | None = None,
    dark: bool = False,
) -> None:
    """Plot a drop into a file of 1200 x 900 px; the same table gives the same bytes.

    Parameters
    ----------
    table
        One row per sample, at least one, see `build_figure`.
    target
        The file to write, or a stream.
    format
        `png`, or `svg` with its text as text.
    facts
        What to point out; None for what the table alone shows.
    dark
        Whether it is for a dark page.

    Raises
    ------
    ValueError
        If the table has no samples.
    OSError
        If the file cannot be written.
    """
    figure = build_figure(table, facts, dark=dark)
    with style.plain(style.DARK if dark else style.LIGHT):
        if format == "svg":
            figure.savefig(target, format="svg", metadata={"Date": None})
            return
        pixels = io.BytesIO()
        figure.savefig(pixels, format="rgba")
    size = figure.canvas.get_width_height()
    image = Image.frombytes("RGBA", size, pixels.getvalue()).convert("RGB")
    # 256 colours are enough for a plot's flat areas and soft edges, in a third of the bytes.
    few = image.quantize(256, dither=Image.Dither.NONE)
    says = PngImagePlugin.PngInfo()
    says.add_text("Comment", MADE_BY_DROP.decode())
    few.save(target, format="png", pnginfo=says)


def build_figure(table: pl.DataFrame, facts: Facts | None = None, *, dark: bool = False) -> Figure:
    """Return the figure of a drop: heights above, error terms below, on one time axis.

    Parameters
    ----------
    table
        One row per sample, at least one: `time_s`, `phase` (falling, contact or rest),
        `simulated_m`, `free_fall_m`, `damped_fall_m`, and `timestep_m`, `damping_m`,
        `interaction_m`, `rounding_m`, which are null where theory does not cover a sample.
    facts
        What to point out; None for what the table alone shows.
    dark
        Whether it is for a dark page.

    Returns
    -------
    A figure of two axes labelled `height` and `error`; where there is room for the impact
    enlarged, `height` has it as its child `impact`.

    Raises
    ------
    ValueError
        If the table has no samples.
    """
    if not len(table):
        raise ValueError("a plot needs at least one sample, got an empty table")
    facts = facts or facts_of(table)
    ink = style.DARK if dark else style.LIGHT
    table = with_theory_that_applies(table)
    explained = table.drop_nulls(COLUMNS)
    end_s = float(table["time_s"][-1])
    time = style.unit_for(end_s, style.SECONDS, usual="s")
    # After an early impact the right half of both panels is empty and takes the explanations;
    # else that is written beside them.
    roomy = not len(explained) or float(explained["time_s"][-1]) < 0.56 * end_s
    with style.plain(ink):
        figure = Figure(figsize=(8, 6), dpi=150)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.15, 1])
        subtitle = textwrap.wrap(style.words(facts.subtitle), LINE, max_lines=2, placeholder=" …")
        lower = 0.03 * (len(subtitle) > 1)
        figure.subplots_adjust(0.1, 0.085, 0.97 if roomy else 0.715, 0.845 - lower, hspace=0.12)
        above.set_label("height")
        below.set_label("error")
        below.set_xlim(0, end_s * time.per_si or 1)
        below.set_xlabel(style.words("time [{unit}]", unit=time.name))
        figure.text(0.02, 0.972, style.words(facts.title), size=15, weight="bold", va="top")
        figure.text(0.02, 0.921, "\n".join(subtitle), size=10.5, color=ink.faint, va="top")
        draw_heights(above, table, impact_s=facts.impact_s, rest_m=facts.rest_m, time=time, ink=ink)
        if roomy and facts.impact_s is not None and stays_low(table, facts.impact_s):
            enlarge_impact(above, table, facts.impact_s, ink)
        unit = draw_terms(below, explained, time, ink)
        if facts.impact_s is not None and len(explained):
            style.mark_time(below, facts.impact_s, time, ink)
        if len(explained):
            row = row_at(explained, facts.at_s)
            sum_up(below, row, time, unit, ink, left=0.60 if roomy else 1.03)
        figure.align_ylabels([above, below])
        figure.legend(  # above the panels, where no curve can run through it
            *above.get_legend_handles_labels(),
            loc="center right",
            bbox_to_anchor=(0.98, 0.868 - lower),
            ncols=len(CURVES),
            borderaxespad=0,
            borderpad=0,
            handlelength=1.6,
            columnspacing=1.4,
        )
    return figure


def with_theory_that_applies(table: pl.DataFrame) -> pl.DataFrame:
    """Leave out theory where it does not apply: to a body that never moved, or to a bounce.

    A fall of 4 m beside a simulation that was never stepped explains nothing.
    """
    if _stands_still(table):
        return table.with_columns(pl.lit(None, pl.Float64).alias(name) for name in THEORY)
    return until_it_bounces(table)


def _stands_still(table: pl.DataFrame) -> bool:
    """Whether the body never moves while theory does; without weight neither does."""
    first = table.row(0, named=True)
    moves = {name: bool((table[name] != first[name]).any()) for name in ("simulated_m", *THEORY)}
    return not moves["simulated_m"] and any(moves[name] for name in THEORY)


def until_it_bounces(table: pl.DataFrame) -> pl.DataFrame:
    """End theory where it lands if the body leaves the floor again: it does not cover a bounce."""
    landed = np.flatnonzero((table["phase"] != "falling").to_numpy())
    theory = table.select("free_fall_m", "damped_fall_m").to_numpy()
    heights_m = table["simulated_m"].to_numpy()
    if not len(landed):
        return table
    floor_m = theory[landed[0] :].min()
    if heights_m[landed[0] :].max() - floor_m < BOUNCE * (heights_m.max() - floor_m):
        return table
    ends = int((theory > floor_m).any(axis=1).sum())  # where the later of the two has arrived
    rows = pl.int_range(len(table))
    return table.with_columns(pl.when(rows <= ends).then(pl.col("free_fall_m", "damped_fall_m")))


def _crossing_s(table: pl.DataFrame) -> float | None:
    """Return when the simulated height passes the height at which theory stops [s].

    That is between two samples; a body that lands on an edge does not get there before its first
    contact, and counts from that.
    """
    landed = np.flatnonzero((table["phase"] != "falling").to_numpy())
    if not len(landed):
        return None
    heights_m, times_s = table["simulated_m"].to_numpy(), table["time_s"].to_numpy()
    floor_m = table["free_fall_m"].to_numpy()[landed].min()
    below = np.flatnonzero(heights_m[: landed[0]] < floor_m)
    if not len(below) or below[0] == 0:
        return float(times_s[landed[0]])
    last, first = below[0] - 1, below[0]
    part = (heights_m[last] - floor_m) / (heights_m[last] - heights_m[first])
    return float(times_s[last] + part * (times_s[first] - times_s[last]))

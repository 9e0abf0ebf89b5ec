"""Output files of `drop trust` besides the recordings: a table and a plot."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drop_physics import colours
from drop_physics.errors import check_suffix
from drop_physics.figures.plot import Curve, Panel, Plot
from drop_physics.files.outputs import check_apart, check_table, check_target
from drop_physics.files.whole import written_whole
from drop_physics.messages import Message

if TYPE_CHECKING:
    import polars as pl

    from drop_physics.stages.trust import Trust

COLUMNS = ("variation", "body", "joint", "unit", "moved", "end", "end_s", "most", "most_s",
           "from_s", "term")  # fmt: skip
"""Columns of the table, which has a row per variation and position; distances are from the script's
own run [m, rad]."""
TEXTS = {"variation", "body", "joint", "unit", "term"}
"""Columns that contain text."""
COLOURS = (*colours.TERMS.values(), colours.SIMULATED, *colours.ENGINES.values())
LEAST = 1e-17
"""Distances below this are drawn as 0."""


def check_outputs(
    script: str, table: Path | None, plot: Path | None, *, is_module: bool, force: bool
) -> None:
    """Check that the table and the plot can be written, before any work is done for them.

    Raises
    ------
    ScenarioError
        If a file's suffix is not supported.
    OutputError
        If a file exists and `force` is not given, or cannot be written.
    """
    if table is not None:
        check_table(table, force=force)
    if plot is not None:
        check_suffix("--plot", plot, (".png", ".svg"))
        check_target(plot, force=force)
    outputs = [each for each in (table, plot) if each is not None]
    check_apart(outputs, inputs=[] if is_module else [Path(script)])


def write_outputs(
    trust: Trust, table: Path | None, plot: Path | None, *, dark: bool, force: bool
) -> None:
    """Write the table and the plot."""
    if table is not None:
        from drop_physics.files.table import write_table

        write_table(table, table_of(trust), force=force)
    if plot is not None:
        from drop_physics.figures import panel_plot  # loads matplotlib

        with written_whole(plot, force=force) as file:
            file.write(panel_plot.render(distances_of(trust), plot.suffix[1:], dark))


def distances_of(trust: Trust) -> Plot:
    """Return the plot of the distances between variations and the script's own run over time."""
    title = Message("How far variations of {script} are from its own run", script=trust.script)
    lines = [
        finding.message for finding in trust.findings if finding.code in ("one-of-many", "grows")
    ]
    return Plot(title, lines, [*_panels(trust)])


def table_of(trust: Trust) -> pl.DataFrame:
    """Return a table with a row per variation and position."""
    import polars as pl  # slow to load, and few need it

    rows = [
        {
            "variation": variation.name,
            "term": variation.term if track is variation.apart.first else None,
            "from_s": None if track.from_step is None else track.from_s,
            **{
                name: getattr(track, name)
                for name in COLUMNS
                if name not in ("variation", "term", "from_s")
            },
        }
        for variation in trust.variations
        for track in variation.apart.tracks
    ]
    return pl.DataFrame(
        rows, schema={name: pl.String if name in TEXTS else pl.Float64 for name in COLUMNS}
    )


def _panels(trust: Trust) -> Iterator[Panel]:
    """Yield panels of the largest distances over time: of positions, and of angles."""
    titles = {
        "m": Message("largest distance of a position"),
        "rad": Message("largest distance of an angle"),
    }
    for unit, title in titles.items():
        curves = []
        for number, variation in enumerate(trust.variations):
            times_s, off = variation.apart.curves.get(unit, (np.empty(0), np.empty(0)))
            values = np.where((off > LEAST) & np.isfinite(off), off, np.nan)
            if np.isfinite(values).any():
                colour = COLOURS[number % len(COLOURS)]
                curves.append(Curve(variation.name, times_s, values, colour))
        if curves:
            yield Panel(title, unit, curves, log=True)

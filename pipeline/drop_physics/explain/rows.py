"""The table of samples: what each is, where, how far off free fall, and its energy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.explain.judged import SEGMENTS, Judged
from drop_physics.explain.times import Times
from drop_physics.physics.vectors import summed

Float64 = NDArray[np.float64]

COLUMNS = {
    "step": pl.Int64, "time_s": pl.Float64, "body": pl.Int64, "label": pl.String,
    "segment": pl.String, "x_m": pl.Float64, "y_m": pl.Float64, "z_m": pl.Float64,
    "error_x_m": pl.Float64, "error_y_m": pl.Float64, "error_z_m": pl.Float64,
    "energy_j": pl.Float64, "contact_j": pl.Float64, "remainder": pl.Float64,
}  # fmt: skip
"""An error is that of the flight with the sample, else null; the remainder is that of the step that
led to it, over its largest term."""
MOST_ROWS = 1 << 17
"""Rows that a table has at most, but for changes, without being asked for."""
SHOWN_PER_S = 60.0
"""Rows of a body that are kept at most where not all are."""


def rows_of(
    judged: Judged,
    base_m: Float64,
    errors_m: Mapping[int, Float64],
    times: Times,
    *,
    detailed: bool,
) -> pl.DataFrame:
    """Return a row for each sample of a body in a piece.

    `base_m`: where its base is, shape (n, 3); `errors_m`: how far off free fall it is, by row;
    `detailed`: whether each joint and each term has its columns (`details_of`).
    """
    n, body = len(judged.steps), judged.body
    error_m = np.full((n, 3), np.nan)
    energy_j, contact_j = np.full(n, np.nan), np.zeros(n)
    if errors_m:
        error_m[[*errors_m]] = [*errors_m.values()]
    for steps in judged.stretches:
        rows = np.searchsorted(judged.steps, steps.steps)
        if steps.law.tree.size:
            energy_j[rows] = steps.changes.after_j
            if rows[0] and not steps.put[0] and np.isnan(energy_j[rows[0] - 1]):
                energy_j[rows[0] - 1] = steps.changes.begin_j
        given = summed(
            steps.reported.contacts.step, steps.point_energy_j[:, None], count=len(steps)
        )
        contact_j[rows] = given[:, 0]
    named = {
        "step": judged.steps,
        "time_s": times.of_all(judged.steps),
        "body": np.full(n, body.number),
        "label": pl.repeat(body.label, n, eager=True),
        "segment": pl.Series(SEGMENTS).gather(judged.segment),
        **{f"{axis}_m": base_m[:, k] for k, axis in enumerate("xyz")},
        **{f"error_{axis}_m": error_m[:, k] for k, axis in enumerate("xyz")},
        "energy_j": energy_j,
        "contact_j": contact_j,
        "remainder": judged.unexplained,
    }
    details = details_of(judged) if detailed else {}
    schema = COLUMNS | dict.fromkeys(details, pl.Float64)
    return pl.DataFrame(named | details, schema=schema, nan_to_null=True)


def details_of(judged: Judged) -> dict[str, Float64]:
    """Return further columns: each joint's position and motor, and the energy that each term gave.

    Of a joint that turns about a point there is none.
    """
    columns: dict[str, Float64] = {}
    for steps in judged.stretches:
        rows, tree = np.searchsorted(judged.steps, steps.steps), steps.law.tree
        efforts = steps.reported.motors + steps.reported.pd + steps.reported.commanded
        found = {
            f"{cause.replace(' ', '_')}_j": gave
            for cause, gave in steps.changes.energy_j.items()
            if cause != "contacts"
        }
        for joint, rate, at in zip(judged.body.joints, tree.rates, tree.coordinates, strict=True):
            if rate.stop - rate.start == 1:
                slides = joint.kind == "prismatic"
                k = rate.start - tree.first_rate
                found[f"{joint.name}.{'m' if slides else 'rad'}"] = steps.after.joints[:, at.start]
                found[f"{joint.name}.{'n' if slides else 'n_m'}"] = efforts[:, k]
        for name, values in found.items():
            columns.setdefault(name, np.full(len(judged.steps), np.nan))[rows] = values
    return columns


def shown(rows: pl.DataFrame, *, per_s: float) -> pl.DataFrame:
    """Return the rows of a body that a curve or a state shows: so many a second, and changes."""
    if np.isinf(per_s):
        return rows
    due = (pl.col("time_s") * per_s + 1e-9).floor()
    flies = pl.col("error_z_m").is_not_null()
    segment = pl.col("segment")
    kept = due != due.shift(1, fill_value=-1)
    kept |= segment != segment.shift(1, fill_value="")
    kept |= (flies != flies.shift(1, fill_value=False)) | (
        flies != flies.shift(-1, fill_value=False)
    )
    number = pl.int_range(pl.len())
    return rows.filter(kept | (number == pl.len() - 1) | (number == 0))

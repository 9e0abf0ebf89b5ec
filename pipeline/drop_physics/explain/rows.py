"""The table of samples: kind of step, position, deviation from free fall, and energy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64
from drop_physics.explain.step_status import SEGMENTS, SampleStatus
from drop_physics.explain.times import StepTimes
from drop_physics.trace.events import Body

if TYPE_CHECKING:
    import polars as pl


COLUMNS = {
    "step": "Int64", "time_s": "Float64", "body": "Int64", "label": "String",
    "segment": "String", "x_m": "Float64", "y_m": "Float64", "z_m": "Float64",
    "error_x_m": "Float64", "error_y_m": "Float64", "error_z_m": "Float64",
    "energy_j": "Float64", "contact_j": "Float64", "remainder": "Float64",
}  # fmt: skip
"""Columns of the table, and their Polars types.

Errors are null except in flight. The remainder is that of the step before the sample, divided by
the step's largest term.
"""
MOST_ROWS = 1 << 17
"""Maximum number of rows of a thinned table, in addition to rows at which something changes."""
SHOWN_PER_S = 60.0
"""Maximum number of rows per second of a body in a thinned table."""


@dataclass(frozen=True, eq=False)
class SampleRows:
    """Table rows for n samples of a body."""

    body: Body
    columns: dict[str, NDArray[Any]]
    """Columns of shape (n,): those of `COLUMNS` except body and label, then those of joints and
    terms.

    `segment` contains indices into `SEGMENTS`.
    """

    def shown(self, *, per_s: float) -> SampleRows:
        """Thin the rows to `per_s` per second, but keep those where the kind of step changes."""
        if np.isinf(per_s):
            return self
        due = np.floor(self.columns["time_s"] * per_s + 1e-9)
        flies, segment = ~np.isnan(self.columns["error_z_m"]), self.columns["segment"]
        kept = np.ones(len(due), np.bool_)
        kept[1:] = (due[1:] != due[:-1]) | (segment[1:] != segment[:-1]) | (flies[1:] != flies[:-1])
        kept[:-1] |= flies[1:] != flies[:-1]
        kept[-1:] = True
        return SampleRows(self.body, {name: column[kept] for name, column in self.columns.items()})


def joined(parts: Sequence[SampleRows]) -> list[SampleRows]:
    """Concatenate table rows of the same body; columns that a part lacks become nan."""
    of_bodies: dict[int, list[SampleRows]] = {}
    for part in parts:
        of_bodies.setdefault(part.body.number, []).append(part)
    return [_joined(of_bodies[number]) for number in sorted(of_bodies)]


def _joined(parts: Sequence[SampleRows]) -> SampleRows:
    steps = np.concatenate([part.columns["step"] for part in parts])
    order = np.argsort(steps, kind="stable")
    names = dict.fromkeys(name for part in parts for name in part.columns)
    columns = {
        name: np.concatenate(
            [part.columns.get(name, np.full(len(part.columns["step"]), np.nan)) for part in parts]
        )[order]
        for name in names
    }
    return SampleRows(parts[0].body, columns)


def table_of(bodies: Sequence[SampleRows]) -> pl.DataFrame:
    """Concatenate all bodies' rows into one table; columns that a body lacks become null."""
    import polars as pl  # slow to load, and few need it

    more = dict.fromkeys(name for body in bodies for name in body.columns if name not in COLUMNS)
    counts = [len(body.columns["step"]) for body in bodies]
    which = pl.Series(np.repeat(np.arange(len(bodies)), counts))
    table: dict[str, Any] = {
        name: np.concatenate(
            [
                body.columns.get(name, np.full(count, np.nan))
                for body, count in zip(bodies, counts, strict=True)
            ]
        )
        for name in (*COLUMNS, *more)
        if bodies and name not in ("body", "label")
    }
    if bodies:
        table["body"] = pl.Series([body.body.number for body in bodies]).gather(which)
        table["label"] = pl.Series([body.body.label for body in bodies]).gather(which)
        table["segment"] = pl.Series(SEGMENTS).gather(table["segment"])
    kinds = {name: getattr(pl, kind) for name, kind in COLUMNS.items()}
    schema = kinds | dict.fromkeys(more, pl.Float64)
    return pl.DataFrame(table, schema=schema, nan_to_null=True)


def rows_of(
    judged: SampleStatus,
    base_m: Float64,
    errors_m: Mapping[int, Float64],
    times: StepTimes,
    *,
    detailed: bool,
) -> SampleRows:
    """Return table rows for a body's samples in a chunk.

    `base_m` is the position of the body's base, shape (n, 3), `errors_m` the deviation from free
    fall, by row; `detailed` adds columns for each joint and each term (`details_of`).
    """
    n = len(judged.steps)
    error_m = np.full((n, 3), np.nan)
    energy_j, contact_j = np.full(n, np.nan), np.zeros(n)
    if errors_m:
        error_m[[*errors_m]] = [*errors_m.values()]
    for steps in judged.intervals:
        rows = np.searchsorted(judged.steps, steps.steps)
        if steps.law.tree.size:
            energy_j[rows] = steps.changes.after_j
            if rows[0] and not steps.put[0] and np.isnan(energy_j[rows[0] - 1]):
                energy_j[rows[0] - 1] = steps.changes.begin_j
        contact_j[rows] = steps.contact_j
    named: dict[str, NDArray[Any]] = {
        "step": judged.steps,
        "time_s": times.of_all(judged.steps),
        "segment": judged.segment,
        **{f"{axis}_m": base_m[:, k] for k, axis in enumerate("xyz")},
        **{f"error_{axis}_m": error_m[:, k] for k, axis in enumerate("xyz")},
        "energy_j": energy_j,
        "contact_j": contact_j,
        "remainder": judged.unexplained,
    }
    return SampleRows(judged.body, named | (details_of(judged) if detailed else {}))


def details_of(judged: SampleStatus) -> dict[str, Float64]:
    """Return extra columns: joint positions and motors, and the energy that each term gave.

    Spherical joints are left out.
    """
    columns: dict[str, Float64] = {}
    for steps in judged.intervals:
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

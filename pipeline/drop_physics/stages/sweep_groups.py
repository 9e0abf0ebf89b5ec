"""What groups of rows of a sweep show: how the error converges, and how it spreads."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from drop_physics.drop.convergence import StudiedRun, Study, study_of
from drop_physics.drop.statistics import Summary, summaries
from drop_physics.sweeping.folder import EXPLAINED, TERMS
from drop_physics.sweeping.plan import Plan, label_of


@dataclass(frozen=True)
class Group:
    """Scenarios that share the values of some fields, and their result."""

    values: dict[str, Any]
    """The shared values of the fields that vary within the sweep."""
    label: str
    """The shared values in words."""
    study: Study | None = None
    left_out_s: tuple[float, ...] = ()
    """Timesteps that the study leaves out, because their sample is at another time."""
    statistics: tuple[Summary, ...] = ()
    """Statistics over the same samples: those in the air, or if there are none, all that did not
    fail."""
    samples: int = 0
    """Number of samples, in the air or not."""
    in_the_air: bool = True
    """Whether the statistics are over the samples in the air."""


def _groups(rows: pl.DataFrame, fields: list[str]) -> Iterator[tuple[dict[str, Any], pl.DataFrame]]:
    """Yield rows that share the values of some fields, in order of first appearance."""
    if not fields:
        if len(rows):
            yield {}, rows
        return
    for values, group in rows.group_by(fields, maintain_order=True):
        yield dict(zip(fields, values, strict=True)), group


def studies_of(plan: Plan, results: pl.LazyFrame) -> list[Group]:
    """Return a refinement study of each set of runs that differ only in the timestep.

    A study only takes runs whose error was broken down, and at exactly the same time.
    """
    if "timestep_s" not in plan.axes or plan.samples is not None:
        return []
    others = [name for name in plan.axes if name != "timestep_s"]
    columns = [*others, "timestep_s", "time_s", "simulated_m", *TERMS]
    rows = results.filter(EXPLAINED).select(columns).collect()
    groups = []
    for values, group in _groups(rows, others):
        times_s = group["time_s"].to_numpy()
        alike = np.abs(times_s - times_s[:, None]) <= 1e-9 * times_s
        same = alike[alike.sum(axis=1).argmax()]  # those at the most common time
        runs = [
            StudiedRun(**row)
            for row in group.filter(same).drop(*others, "time_s").iter_rows(named=True)
        ]
        left_out = tuple(group.filter(~same)["timestep_s"])
        if len(runs) > 1:
            groups.append(Group(values, label_of(values), study_of(runs), left_out))
    return groups


def statistics_of(plan: Plan, results: pl.LazyFrame) -> list[Group]:
    """Return the statistics of each scenario that is sampled."""
    if plan.samples is None:
        return []
    groups = []
    for combination in range(plan.runs // plan.samples):
        first, last = combination * plan.samples, (combination + 1) * plan.samples
        rows = results.filter(pl.col("run").is_between(first, last - 1))
        listed = plan.listed(combination)
        values = {name: listed[name] for name in plan.axes}
        in_the_air = tuple(summaries(rows.filter(EXPLAINED), TERMS))
        groups.append(
            Group(
                values,
                label_of(values),
                statistics=in_the_air or tuple(summaries(rows, TERMS)),
                samples=rows.select(pl.len()).collect().item(),
                in_the_air=bool(in_the_air),
            )
        )
    return groups

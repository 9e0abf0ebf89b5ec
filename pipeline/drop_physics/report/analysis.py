"""What the analysis of a recording found."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import polars as pl

from drop_physics.drop.results import DropAnalysis
from drop_physics.fields import counted
from drop_physics.messages import Message
from drop_physics.report.blocks import (
    Column,
    DataTable,
    FindingList,
    Graphs,
    Report,
    Section,
    numbers,
)
from drop_physics.report.bodies import report_of_bodies
from drop_physics.report.drop import report_of_drop
from drop_physics.report.words import MISSING, unfinished
from drop_physics.rules.choice import EVERY, Choice
from drop_physics.stages.panels import plot_of

if TYPE_CHECKING:
    from drop_physics.analysis.results import Analysis

MOST_AT_THE_END = 12
"""Bodies, and joints, whose ends are listed."""
TOO_GRAVE = 3
"""The exit code of an analysis with findings that are as grave as `--fail-on` says."""


def report_of(
    analysis: Analysis, *, verbose: bool = False, choice: Choice = EVERY, at_the_end: bool = False
) -> Report:
    """Say what happened; without `verbose` on one screen.

    With `at_the_end` only what is found, and where everything ends: what a golden recording holds.
    """
    if at_the_end:
        return report_of_end(analysis)
    if isinstance(analysis, DropAnalysis):
        report = report_of_drop(analysis, verbose=verbose)
    else:
        report = report_of_bodies(analysis, verbose=verbose)
    curves = Section([Graphs(partial(plot_of, analysis))], apart=False)
    first, *others = report.sections
    report = replace(report, sections=[first, curves, *others])
    notes: list[str] = []
    if analysis.partial:
        notes.append(unfinished(analysis.recording, _samples(analysis)))
    if analysis.lacks is not None:
        notes.append(analysis.lacks)
    grave = choice.grave(analysis.findings)
    if not grave:
        return replace(report, notes=notes)
    remark = Message(
        "{findings} of level {level} or worse: {codes}",
        findings=counted(len(grave), "finding"),
        level=choice.fail_on,
        codes=", ".join(dict.fromkeys(each.code for each in grave)),
    )
    return replace(report, notes=notes, remarks=[remark], code=TOO_GRAVE)


def _samples(analysis: Analysis) -> int:
    if analysis.kind == "drop":  # whose floor has no samples of its own
        return analysis.samples
    return sum(sum(body.segments.values()) for body in analysis.bodies)


def report_of_end(analysis: Analysis) -> Report:
    """Say what was found, and where bodies and joints end, to the micrometre and microradian."""
    found = FindingList(analysis.findings, len(analysis.findings))
    if isinstance(analysis, DropAnalysis):
        last_m = _digits(analysis.table["simulated_m"][-1])
        end = DataTable([Column("at the end", ["centre"]), numbers("z [m]", [last_m])])
        return replace(report_of_drop(analysis), sections=[Section([found, end])])
    last = analysis.table.group_by("body", maintain_order=True).last()
    last = last.filter(pl.col("z_m").is_not_null()).head(MOST_AT_THE_END)
    ends = DataTable(
        [
            Column("at the end", last["label"].to_list()),
            *(numbers(f"{axis} [m]", [*map(_digits, last[f"{axis}_m"])]) for axis in "xyz"),
        ]
    )
    joints = [(body.label, row) for body in analysis.bodies for row in body.joints]
    reached = [(label, row) for label, row in joints if row.reached is not None]
    rows = reached[:MOST_AT_THE_END]
    table = DataTable(
        [
            Column("joint", [f"{label} {row.name}" for label, row in rows]),
            numbers("reached", [f"{_digits(row.reached)} {row.unit}" for _, row in rows]),
        ]
    )
    report = report_of_bodies(analysis)
    return replace(report, sections=[Section([found, ends, *([table] if rows else [])])])


def _digits(value: float | None) -> str:
    # What rounds to zero has no sign.
    return MISSING if value is None else f"{round(value, 6) + 0.0:.6f}"

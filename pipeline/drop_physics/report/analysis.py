"""The report of the command `analyze`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from drop_physics.fields import counted
from drop_physics.messages import Message, shell_command
from drop_physics.report.blocks import (
    Column,
    DataTable,
    Fact,
    Facts,
    FindingList,
    Graphs,
    Report,
    Section,
    numbers,
)
from drop_physics.report.bodies import looked_at, one_screen, report_of_bodies
from drop_physics.report.drop import report_of_drop
from drop_physics.report.words import MISSING, unfinished
from drop_physics.rules.choice import EVERY, Choice
from drop_physics.stages.info import repeated
from drop_physics.stages.panels import plot_of, plot_of_row

if TYPE_CHECKING:
    from drop_physics.analysis.results import Analysis
    from drop_physics.drop.results import DropAnalysis

MOST_AT_THE_END = 12
"""Most bodies, and most joints, whose final positions are listed."""
SURVIVES = "not terminated"
"""Expectation suggested for an episode that was terminated without reaching its goal."""
TOO_GRAVE = 3
"""Exit code of an analysis with a finding at or above the level of `--fail-on`."""


def report_of(
    analysis: Analysis,
    *,
    verbose: bool = False,
    most_rows: int | None = None,
    choice: Choice = EVERY,
    at_the_end: bool = False,
) -> Report:
    """Report an analysis on one screen, or completely with `verbose`.

    With `at_the_end`, the report has only the findings and the final state, as in a golden
    recording's page.
    """
    if at_the_end:
        return report_of_end(analysis)
    if analysis.kind == "drop":
        report = report_of_drop(_of_drop(analysis), verbose=verbose)
    else:
        report = report_of_bodies(analysis, verbose=verbose, most_rows=most_rows)
    curves = Section([Graphs(partial(plot_of, analysis)), *_row_drawn(analysis)], apart=False)
    first, *others = report.sections
    sections = [first, curves, *others, *_not_said(analysis)]
    report = replace(report, sections=sections, next=[*next_commands(analysis)])
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


def _row_drawn(analysis: Analysis) -> Iterator[Graphs]:
    """Yield the curve for the account's first row, or for the finding shown instead of it."""
    if analysis.kind == "script":
        screen = one_screen(analysis)
        found = [finding.row for finding in screen.findings[: screen.most_findings]]
        rows = [*(row for row in found if row is not None), *screen.rows[: screen.most_rows]]
        yield Graphs(partial(plot_of_row, analysis, rows))


def _not_said(analysis: Analysis) -> Iterator[Section]:
    """Yield notes on missing data that make the analysis incomplete."""
    if analysis.notes:
        titles = [Message("not said"), *[""] * (len(analysis.notes) - 1)]
        rows = map(Fact, titles, analysis.notes)
        yield Section([Facts([*rows])])


def next_commands(analysis: Analysis) -> Iterator[str]:
    """Yield commands to run next: trials of the script, if its file exists, and the viewer."""
    if analysis.recording is None or not analysis.samples:
        return
    origin = analysis.origin
    if origin is not None and analysis.samples > 1:
        name = str(origin["script"])
        script = analysis.sources.get(name)
        failed = any(
            episode.failed and episode.ended == "terminated" for episode in analysis.episodes
        )
        proof = repeated("why", origin, script, expect=SURVIVES if failed else None)
        if proof is not None and (script is not None or name.startswith("-m ")):
            yield proof
    yield shell_command("drop", "view", analysis.recording)


def _of_drop(analysis: Analysis) -> DropAnalysis:
    from drop_physics.drop.results import DropAnalysis

    assert isinstance(analysis, DropAnalysis)
    return analysis


def _samples(analysis: Analysis) -> int:
    if analysis.kind == "drop":  # whose floor has no samples of its own
        return analysis.samples
    return sum(sum(body.segments.values()) for body in analysis.bodies)


def report_of_end(analysis: Analysis) -> Report:
    """Report the findings, and the final positions to the micrometre and microradian."""
    most = len(analysis.findings)
    found = FindingList(analysis.findings, most, analysis.left_out, looked_at=looked_at(analysis))
    if analysis.kind == "drop":
        last_m = _digits(analysis.table["simulated_m"][-1])
        end = DataTable([Column("at the end", ["centre"]), numbers("z [m]", [last_m])])
        return replace(report_of_drop(_of_drop(analysis)), sections=[Section([found, end])])
    last = [
        (each.body.label, [float(each.columns[f"{axis}_m"][-1]) for axis in "xyz"])
        for each in analysis.rows
        if len(each.columns["z_m"]) and not np.isnan(each.columns["z_m"][-1])
    ][:MOST_AT_THE_END]
    ends = DataTable(
        [
            Column("at the end", [label for label, _ in last]),
            *(
                numbers(f"{axis} [m]", [_digits(place_m[k]) for _, place_m in last])
                for k, axis in enumerate("xyz")
            ),
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

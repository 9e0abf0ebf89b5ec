"""What the analysis of a recording found."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drop_physics.drop.results import DropAnalysis
from drop_physics.fields import counted
from drop_physics.messages import Message
from drop_physics.report.blocks import Report
from drop_physics.report.bodies import report_of_bodies
from drop_physics.report.drop import report_of_drop
from drop_physics.report.words import unfinished
from drop_physics.rules.choice import EVERY, Choice

if TYPE_CHECKING:
    from drop_physics.analysis.results import Analysis

TOO_GRAVE = 3
"""The exit code of an analysis with findings that are as grave as `--fail-on` says."""


def report_of(analysis: Analysis, *, verbose: bool = False, choice: Choice = EVERY) -> Report:
    """Say what happened; without `verbose` on one screen."""
    if isinstance(analysis, DropAnalysis):
        report = report_of_drop(analysis, verbose=verbose)
    else:
        report = report_of_bodies(analysis, verbose=verbose)
    notes: list[str] = []
    if analysis.partial:
        notes.append(unfinished(analysis.recording, _samples(analysis)))
    if analysis.lacks is not None:
        notes.append(analysis.lacks)
    grave = choice.grave(analysis.findings)
    if not grave:
        return replace(report, notes=notes)
    remark = Message(
        "{findings} of level {level} or graver: {codes}",
        findings=counted(len(grave), "finding"),
        level=choice.fail_on,
        codes=", ".join(dict.fromkeys(each.code for each in grave)),
    )
    return replace(report, notes=notes, remarks=[remark], code=TOO_GRAVE)


def _samples(analysis: Analysis) -> int:
    if analysis.kind == "drop":  # whose floor has no samples of its own
        return analysis.samples
    return sum(sum(body.segments.values()) for body in analysis.bodies)

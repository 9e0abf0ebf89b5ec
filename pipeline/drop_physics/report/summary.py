"""Shortens a script's analysis to about two kilobytes of JSON: what one screen shows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.explain.jsonable import jsonable
from drop_physics.report.account import sides_of, who_of
from drop_physics.report.analysis import next_commands
from drop_physics.report.bodies import one_screen

if TYPE_CHECKING:
    from drop_physics.account.rows import AccountRow
    from drop_physics.analysis.results import Analysis
    from drop_physics.rules.answer import Finding


@dataclass(frozen=True, kw_only=True)
class ShortFinding:
    """A finding for the short JSON, without its numbers."""

    code: str
    """Stable identifier of the kind of finding, for `drop explain CODE`."""
    reason: str | None
    """Short identifier of the cause; None if the code has only one cause."""
    level: str
    """Level: `broken`, `asked`, `model`, `repeat` or `note`."""
    message: str
    """Sentence on the observation, with numbers, and the reason."""
    advice: str | None
    """The suggested call."""
    proof: str
    """How the finding is proved: `sum`, `call` or `trial`; `none` if the advice still needs a trial
    by `drop why`."""
    site: str | None
    """File and line of the call that the finding concerns."""
    terms: str | None
    """Terms of the sum from which the finding follows."""


@dataclass(frozen=True, kw_only=True)
class ShortRow:
    """A row of the account for the short JSON."""

    kind: str
    """The kind of row, as in `drop analyze --json`."""
    who: str
    """The joint, body, pair or reading that the row describes."""
    told: str
    """Sentence on the commanded value, the reached value, and the time."""
    terms: str | None
    """Terms that act for and against the command."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """An analysis for the short JSON."""

    script: str
    """Name of the script, without its folder; `-m NAME` for a module."""
    ended: str
    """How the script ended: `finished`, `error`, …"""
    error: str | None
    """The error that ended the script."""
    error_site: str | None
    """File and line that raised the error."""
    recording: Path | None
    """Path of the recording; `drop analyze --json RECORDING` prints the complete analysis."""
    steps: int
    """Number of steps of the longest simulation."""
    explained: float
    """Share of the samples whose sum of impulses is complete; findings do not cover the others."""
    episodes: int
    """Number of episodes."""
    episode: int | None
    """Number of the episode that the account describes; None for the whole run."""
    findings: list[ShortFinding]
    """The findings shown, the most certain first."""
    further_findings: int
    """Number of findings that are not shown here."""
    account: list[ShortRow]
    """The rows of the account shown, the most salient first."""
    further_rows: int
    """Number of rows that are not shown here."""
    left_out: int
    """Number of findings suppressed by options, by comments in the script or by the project."""
    not_said: list[str]
    """Sentences on gaps in the recording, which the analysis leaves out."""
    next: list[str]
    """Suggested next commands."""


def summary_of(analysis: Analysis) -> Summary:
    """Summarize an analysis."""
    assert analysis.origin is not None
    origin, screen, of = analysis.origin, one_screen(analysis), analysis.explained
    findings, rows = screen.findings[: screen.most_findings], screen.rows[: screen.most_rows]
    return Summary(
        script=str(origin["script"]),
        ended=str(origin["ended"]),
        error=origin["error"],
        error_site=origin["error_site"],
        recording=analysis.recording,
        steps=max(0, analysis.samples - 1),
        explained=of.samples / of.of if of.of else 1.0,
        episodes=len(analysis.episodes),
        episode=analysis.episode,
        findings=[*map(_finding, [*([screen.failed] if screen.failed else []), *findings])],
        further_findings=len(screen.findings) - len(findings),
        account=[*map(_row, rows)],
        further_rows=len(screen.rows) - len(rows),
        left_out=analysis.left_out,
        not_said=[*map(str, analysis.notes), *([str(analysis.lacks)] if analysis.lacks else [])],
        next=[*next_commands(analysis)],
    )


def json_of_summary(analysis: Analysis) -> dict[str, Any]:
    """Return the summary as the JSON object that `drop --json SCRIPT.py` prints."""
    return dict(jsonable(summary_of(analysis)))


def _finding(finding: Finding) -> ShortFinding:
    return ShortFinding(
        code=finding.code,
        reason=finding.reason,
        level=finding.level,
        message=str(finding.said),
        advice=None if finding.advice is None else str(finding.advice),
        proof=finding.proof,
        site=finding.site,
        terms=str(sides_of(finding.terms, finding.row.mean if finding.row else ""))
        if finding.terms
        else None,
    )


def _row(row: AccountRow) -> ShortRow:
    return ShortRow(
        kind=row.kind,
        who=str(who_of(row)),
        told=str(row.told),
        terms=str(sides_of(row.terms)) if row.terms else None,
    )

"""The answer about a script in some two kilobytes of JSON: the contents of a terminal's screen."""

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
    """A finding, without its numbers."""

    code: str
    """A stable name: `drop explain CODE`."""
    reason: str | None
    """The cause, in a word; None where the code has one cause only."""
    level: str
    """Level: `broken`, `asked`, `model`, `repeat` or `note`."""
    message: str
    """Sentence on what was seen, with numbers, and why."""
    advice: str | None
    """The call that changes it."""
    proof: str
    """`sum`, `call` or `trial`; `none` of advice that is only to be tried: `drop why`."""
    site: str | None
    """File and line of the call."""
    terms: str | None
    """The terms of the sum behind it."""


@dataclass(frozen=True, kw_only=True)
class ShortRow:
    """A row of the account."""

    kind: str
    """The kind of row, as in `drop analyze --json`."""
    who: str
    """The joint, body, pair or reading that it is about."""
    told: str
    """Sentence on what was asked, what came, and when."""
    terms: str | None
    """The terms that act towards it, and against."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """The answer about a script."""

    script: str
    """The script, without its folder; `-m NAME` of a module."""
    ended: str
    """Ending of the script: `finished`, `error`, …"""
    error: str | None
    """The error that it ended with."""
    error_site: str | None
    """File and line of that error."""
    recording: Path | None
    """The recording: `drop analyze --json RECORDING` tells everything."""
    steps: int
    """Number of steps of the longest simulation."""
    explained: float
    """Share of the samples whose sum closes: nothing is said of the others."""
    episodes: int
    """Number of episodes."""
    episode: int | None
    """The episode that the account tells; None if the whole run."""
    findings: list[ShortFinding]
    """The findings that are shown, the surest first."""
    further_findings: int
    """Number of findings that are not shown here."""
    account: list[ShortRow]
    """The rows that are shown, the most salient first."""
    further_rows: int
    """Number of rows that are not shown here."""
    left_out: int
    """Number of findings left out by the command, the script or the project."""
    not_said: list[str]
    """Gaps of the recording, about which nothing is said."""
    next: list[str]
    """Commands that tell more."""


def summary_of(analysis: Analysis) -> Summary:
    """Return the answer in short."""
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
    """Return the answer in short, as `drop --json SCRIPT.py` prints it."""
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
        terms=str(sides_of(finding.terms)) if finding.terms else None,
    )


def _row(row: AccountRow) -> ShortRow:
    return ShortRow(
        kind=row.kind,
        who=str(who_of(row)),
        told=str(row.told),
        terms=str(sides_of(row.terms)) if row.terms else None,
    )

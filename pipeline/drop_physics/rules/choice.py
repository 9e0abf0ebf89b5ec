"""Selects the findings to report, and those that make a command fail, as linters do."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from drop_physics.errors import ScenarioError
from drop_physics.fields import alternatives
from drop_physics.messages import Message
from drop_physics.rules.codes import CODES, LEVELS, Level
from drop_physics.rules.thresholds import MINOR

if TYPE_CHECKING:  # a command reads its options before it loads the analysis
    from drop_physics.account.rows import AccountRow
    from drop_physics.rules.answer import Finding

MEANT = frozenset(("no-gravity",))
"""Codes of behaviour that may be intended; such a finding counts as minor even if there is no
other."""
HALF = 0.5
"""Share below which a note without proof counts as minor."""
ALL, NEVER = "all", "never"
"""Keywords that replace a list of codes, or a level."""


@dataclass(frozen=True)
class Picked:
    """The codes that a project's settings, a script or a command select or ignore."""

    select: frozenset[str] | None = None
    """The codes to report; None if this source does not select any."""
    ignore: frozenset[str] = frozenset()
    """The codes not to report."""

    def reports(self, names: set[str | None], before: bool) -> bool:
        """Return whether to report a finding; `before` is the decision so far."""
        if self.select is not None:
            before = bool(self.select & names)
        return before and not self.ignore & names


@dataclass(frozen=True)
class Choice:
    """The findings to report: options override a script's comments, and comments the settings."""

    project: Picked = field(default_factory=Picked)
    command: Picked = field(default_factory=Picked)
    fail_on: Level | None = None
    """The level from which an analysis fails; None for never."""

    def reports(self, finding: Finding, ignored: Collection[str]) -> bool:
        """Return whether to report a finding; `ignored` are the codes suppressed on its line."""
        names = {finding.code, finding.reason, ALL}
        before = self.project.reports(names, True) and names.isdisjoint(ignored)
        return self.command.reports(names, before)

    def grave(self, findings: Sequence[Finding]) -> list[Finding]:
        """Return the findings that are severe enough to make a command fail."""
        most = -1 if self.fail_on is None else LEVELS.index(self.fail_on)
        return [finding for finding in findings if LEVELS.index(finding.level) <= most]


EVERY = Choice()
"""Report all findings, and let none fail the command."""


def picked(select: list[str] | None, ignore: list[str] | None, path: Path | None = None) -> Picked:
    """Parse a list of codes from a settings file or an option.

    Raises
    ------
    ScenarioError
        If a code does not exist; the message names the option or file, and the most similar code.
    """
    for key, names in {"select": select, "ignore": ignore}.items():
        for name in names or ():
            if name not in CODES and name != ALL:
                raise ScenarioError(
                    "{option} takes codes of findings, got {name!r}; did you mean {near}?",
                    option=option_of(key, path),
                    name=name,
                    near=difflib.get_close_matches(name, CODES, 1, 0.0)[0],
                )
    return Picked(None if select is None else frozenset(select), frozenset(ignore or ()))


def option_of(key: str, path: Path | None) -> str:
    """Return the name of an option, as a settings file or a command spells it."""
    return f"--{key}" if path is None else Message("{key} in {path}", key=key, path=str(path))


def level_of(name: str, path: Path | None = None) -> Level | None:
    """Parse the name of a severity; None for `never`.

    Raises
    ------
    ScenarioError
        If no severity has that name.
    """
    for level in LEVELS:
        if name == level:
            return level
    if name == NEVER:
        return None
    raise ScenarioError(
        "{option} takes {levels}, got {name!r}",
        option=option_of("fail-on", path),
        levels=alternatives([*LEVELS, NEVER]),
        name=name,
    )


def minor(findings: Sequence[Finding], account: Sequence[AccountRow] = ()) -> list[Finding]:
    """Return the findings that explain little of the problem.

    Minor findings are: an observation that is no mistake, and small compared with the gravest
    finding; behaviour that may be intended (`MEANT`); a note without proof whose share is below
    `HALF`; and a joint's gap that is small compared with the one in `account`.
    """
    mistakes = [finding for finding in findings if finding.level in ("broken", "asked")]
    most = max((mistake.share for mistake in mistakes or findings), default=0.0)
    return [
        finding
        for finding in findings
        if _beside(finding, account)
        or (
            finding not in mistakes
            and (
                finding.share < MINOR * most
                or (finding.code in MEANT and finding.reason is None)
                or (
                    finding.level == "note"
                    and finding.proof == "none"
                    and finding.effect is not None
                    and finding.share < HALF
                )
            )
        )
    ]


def _beside(finding: Finding, account: Sequence[AccountRow]) -> bool:
    """Return whether the account has a far larger gap of the joint than the finding."""
    effect = finding.effect
    return effect is not None and any(
        row.kind == "asked"
        and (row.body, row.joint, row.unit) == (finding.body, finding.joint, effect.unit)
        and row.joint is not None
        and abs(row.gap or 0.0) * MINOR > effect.value
        for row in account
    )

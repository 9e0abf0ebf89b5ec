"""The selection of findings, as in linters: which are reported, and which fail the command."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from drop_physics.errors import ScenarioError
from drop_physics.fields import alternatives
from drop_physics.messages import Message
from drop_physics.rules.answer import LEVELS, Finding, Level
from drop_physics.rules.codes import CODES
from drop_physics.rules.thresholds import MINOR

MEANT = frozenset(("no-gravity",))
"""Codes of behaviour that may be intended; such a finding is collapsed even if it is the
only one."""
ALL, NEVER = "all", "never"
"""Keywords that replace a list of codes, or a level."""


@dataclass(frozen=True)
class Picked:
    """Codes or reasons selected by one source: a project's settings, or a command."""

    select: frozenset[str] | None = None
    """The codes to report; None if this source does not select any."""
    ignore: frozenset[str] = frozenset()
    """The codes not to report."""

    def reports(self, names: set[str | None], before: bool) -> bool:
        """Return whether to report a finding with these names; `before`: the decision so far."""
        if self.select is not None:
            before = bool(self.select & names)
        return before and not self.ignore & names


@dataclass(frozen=True)
class Choice:
    """The selection of findings: the command overrides the script, which overrides settings."""

    project: Picked = field(default_factory=Picked)
    command: Picked = field(default_factory=Picked)
    fail_on: Level | None = None
    """The level from which an analysis fails; None for never."""

    def reports(self, finding: Finding, ignored: Collection[str]) -> bool:
        """Return whether to report a finding; `ignored`: the codes suppressed on its line."""
        names = {finding.code, finding.reason, ALL}
        before = self.project.reports(names, True) and names.isdisjoint(ignored)
        return self.command.reports(names, before)

    def grave(self, findings: Sequence[Finding]) -> list[Finding]:
        """Return the findings severe enough to make an analysis fail."""
        most = -1 if self.fail_on is None else LEVELS.index(self.fail_on)
        return [finding for finding in findings if LEVELS.index(finding.level) <= most]


EVERY = Choice()
"""Report all findings, and let none fail the command."""


def picked(select: list[str] | None, ignore: list[str] | None, path: Path | None = None) -> Picked:
    """Parse a list of codes from a project's file or a command's options.

    Raises
    ------
    ScenarioError
        If there is no such code; the message says where, and which code is alike.
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
    """Return the name of an option as written in a project's file or in a command."""
    return f"--{key}" if path is None else Message("{key} in {path}", key=key, path=str(path))


def level_of(name: str, path: Path | None = None) -> Level | None:
    """Parse the name of a level; None for `never`.

    Raises
    ------
    ScenarioError
        If there is none of that name.
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


def minor(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings that are no mistake and explain little of the problem."""
    mistakes = [finding for finding in findings if finding.level in ("broken", "asked")]
    most = max((mistake.share for mistake in mistakes or findings), default=0.0)
    return [
        finding
        for finding in findings
        if finding not in mistakes
        and (finding.share < MINOR * most or (finding.code in MEANT and finding.reason is None))
    ]

"""The choice of findings, as in linters: those reported, and those that fail the command."""

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
"""Codes of what may be meant; such a finding is folded away even if it is alone."""
ALL, NEVER = "all", "never"
"""Words in place of codes, and of a level."""


@dataclass(frozen=True)
class Picked:
    """Codes or reasons named in one place: a project's settings, or a command."""

    select: frozenset[str] | None = None
    """The codes that are reported; None where this place does not say."""
    ignore: frozenset[str] = frozenset()
    """The codes that are not reported."""

    def reports(self, names: set[str | None], before: bool) -> bool:
        """Return whether a finding of these names is reported; `before`: whether it was so far."""
        if self.select is not None:
            before = bool(self.select & names)
        return before and not self.ignore & names


@dataclass(frozen=True)
class Choice:
    """The reported findings: a command overrides a script, which overrides settings."""

    project: Picked = field(default_factory=Picked)
    command: Picked = field(default_factory=Picked)
    fail_on: Level | None = None
    """The level from which on an analysis fails; None for never."""

    def reports(self, finding: Finding, ignored: Collection[str]) -> bool:
        """Return whether a finding is reported; `ignored` are the codes left out at its line."""
        names = {finding.code, finding.reason, ALL}
        before = self.project.reports(names, True) and names.isdisjoint(ignored)
        return self.command.reports(names, before)

    def grave(self, findings: Sequence[Finding]) -> list[Finding]:
        """Return the findings that make an analysis fail."""
        most = -1 if self.fail_on is None else LEVELS.index(self.fail_on)
        return [finding for finding in findings if LEVELS.index(finding.level) <= most]


EVERY = Choice()
"""All findings, none of them too grave."""


def picked(select: list[str] | None, ignore: list[str] | None, path: Path | None = None) -> Picked:
    """Return named codes, from a project's file or a command's options.

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
    """Return the name of an option in a project's file or in a command."""
    return f"--{key}" if path is None else Message("{key} in {path}", key=key, path=str(path))


def level_of(name: str, path: Path | None = None) -> Level | None:
    """Return a named level, None for `never`.

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

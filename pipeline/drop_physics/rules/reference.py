"""Collects what `drop explain` says about a code, from the rules that report it."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from drop_physics.errors import ScenarioError
from drop_physics.messages import Message
from drop_physics.rules.codes import CODES, Level
from drop_physics.rules.examples import CodeExample, examples
from drop_physics.rules.rule import Rule
from drop_physics.rules.sources import Limit, RuleTexts, texts_of
from drop_physics.trace.cures import Cure

PLACEHOLDER = re.compile(r"(\}?)\{(\w+)[^{}]*(?=\})")
"""Regular expression of a value in a template: the text before it, if that is another value, and
its name."""
LEAST = 25
"""Minimum number of characters of a message that is a sentence, and not a fragment."""


class Blank:
    """A placeholder for a value that is only known for a finding."""

    def __init__(self, shown: str) -> None:
        self._shown = shown

    def __format__(self, form: str) -> str:
        return self._shown


@dataclass(frozen=True)
class CodeReference:
    """What `drop explain` says about a code or a reason."""

    code: str
    """The code, or the reason."""
    reason_of: str | None
    """The code to which the reason belongs; null for a code."""
    level: Level | None
    """The level, unless a finding states another one; null if it depends on the case."""
    meaning: str
    """Meaning: what was requested and what happened instead, in one sentence."""
    measured: list[str] = field(default_factory=list)
    """The conditions that the rules check, one sentence per rule."""
    thresholds: list[Limit] = field(default_factory=list)
    """The thresholds that the rules of this code use."""
    says: list[str] = field(default_factory=list)
    """Example sentence of a finding; … stands for a number or a name."""
    advises: list[str] = field(default_factory=list)
    """Advice that fixes the problem."""
    proposes: list[str] = field(default_factory=list)
    """Advice that is only a proposal, since nothing proves the cause."""
    example: CodeExample | None = None
    """A script that demonstrates the code; null if the documentation has none."""
    cures: tuple[tuple[str, Cure, bool], ...] = field(default=(), metadata={"json": False})
    """The cures of this code's rules, each as the engine in whose syntax the call is written, the
    cure (nan for values that depend on the run), and whether the cure is only a proposal."""


def reference_of(name: str, rules: Sequence[Rule]) -> CodeReference:
    """Return what `drop explain` says about a code or a reason of given rules.

    Raises
    ------
    ScenarioError
        If no code or reason has that name; the message suggests the most similar one.
    """
    if name not in CODES:
        raise ScenarioError(
            "CODE is a code or a reason of a finding, got {name!r}; did you mean {near}?",
            name=name,
            near=difflib.get_close_matches(name, CODES, 1, 0.0)[0],
        )
    return references(rules, [name])[name]


def references(
    rules: Sequence[Rule], names: Collection[str] = tuple(CODES)
) -> dict[str, CodeReference]:
    """Return what `drop explain` says about codes and reasons of given rules, by name."""
    shown, told = examples(), texts_of(names, rules)
    return {name: _reference(name, told[name], shown.get(name)) for name in names}


def _reference(name: str, told: RuleTexts, example: CodeExample | None) -> CodeReference:
    said = [blanked(say) for say in told.says]
    return CodeReference(
        code=name,
        reason_of=told.reason_of,
        level=told.level,
        meaning=Message(CODES[name]),
        measured=[Message(each) for each in told.measured],
        thresholds=told.thresholds,
        says=[each for each in said if len(each) > LEAST],
        advises=[blanked(advise) for advise in told.advises],
        proposes=[blanked(propose) for propose in told.proposes],
        example=example,
        cures=tuple(told.cures),
    )


def blanked(template: str) -> Message:
    """Return a message with … for its values; adjacent values share one."""
    found = PLACEHOLDER.findall(template)
    values: dict[str, Any] = {name: Blank("" if before else "…") for before, name in found}
    return Message(template, **values)


def sentences(rules: Sequence[Rule]) -> Iterator[str]:
    """Yield all texts of `drop explain` that are not already a `Message` in a rule."""
    for reference in references(rules).values():
        yield from (
            reference.meaning,
            *reference.measured,
            *(limit.meaning for limit in reference.thresholds),
        )

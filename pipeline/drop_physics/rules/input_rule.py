"""A rule of inputs: what calls set is compared with what came of it, once, at the end.

@input_rule("not-taken", "asked", "other-client")
def other_client(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]: ...
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from drop_physics.data import dataclass
from drop_physics.rules.answer import Answer, Finding, Level, Span
from drop_physics.rules.arguments import site_of
from drop_physics.rules.engines import ANY, BULLETS, engine_of
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.rule import Said, finding_of
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body


@dataclass(frozen=True)
class InputSubject:
    """What a finding about inputs is about."""

    call: Call | None
    body: Body | None = None
    joint: str | None = None
    steps: Span | None = None
    site: str | None = None
    """File and line, where no call that sets something is the cause."""


@dataclass(frozen=True, eq=False)
class InputRule:
    """One rule of inputs: its code and reason, and what it says."""

    code: str
    level: Level
    reason: str | None
    matches: Callable[[Inputs], Iterator[tuple[InputSubject, Said]]]
    engines: tuple[str, ...] = BULLETS
    """The engines whose words it has: it is asked of their recordings."""

    @property
    def meaning(self) -> str:
        """What the code means for this reason, in a sentence."""
        return (self.matches.__doc__ or "").strip()


INPUT_RULES: list[InputRule] = []


def input_rule(
    code: str, level: Level, reason: str | None = None, *, engines: tuple[str, ...] = BULLETS
) -> Callable[[Callable[[Inputs], Iterator[tuple[InputSubject, Said]]]], InputRule]:
    """Make a function of all inputs a rule: it yields what it is about, and what is said."""

    def made(matches: Callable[[Inputs], Iterator[tuple[InputSubject, Said]]]) -> InputRule:
        rule = InputRule(code, level, reason, matches, engines)
        INPUT_RULES.append(rule)
        return rule

    return made


class InputRules(Answer):
    """Asks all rules of inputs at the end."""

    engines = ANY

    @np.errstate(all="ignore")
    def findings(self) -> Iterator[Finding]:
        """Yield what each rule says."""
        engine = engine_of(self.scene.seen)
        for rule in (rule for rule in INPUT_RULES if engine in rule.engines):
            for subject, said in rule.matches(self.scene.inputs):
                site = subject.site if subject.call is None else site_of(subject.call)
                reason = said.reason or rule.reason
                said = replace(
                    said, joint=subject.joint, steps=subject.steps, site=site, reason=reason
                )
                body = None if subject.body is None else subject.body.label
                yield finding_of(rule.code, rule.level, said, self.scene, body)

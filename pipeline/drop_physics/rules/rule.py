"""A rule is data: where it holds in a table of what was explained, and what is said of the worst.

    @joint_rule("target-clamped", "asked")
    def target_clamped(joints: JointColumns) -> Match: ...      # a mask, a size, numbers

    @target_clamped.says
    def _(worst: Worst) -> Said: ...                      # a sentence, and the cure

Chunks, the worst row, how often, in which steps, which joints of which body and which line of the
script belong to the mechanism here. It serves joints; `pairs`, `bodies`, `inputs` and `run` hang
their tables on it in the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.joints import Driven, target_of
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Level, Noted, Notes, Scene
from drop_physics.rules.joint import link_of, units_of
from drop_physics.rules.thresholds import AT_TARGET_M, AT_TARGET_RAD
from drop_physics.trace.events import Joint
from drop_physics.trace.motors import POSITION

Float64 = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Match:
    """Where a rule holds in a table; all arrays have the shape of the table's columns."""

    where: Flags
    size: Float64
    """How much it is: of the largest the numbers are kept."""
    numbers: Mapping[str, Float64] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Said:
    """What a rule says of the worst that it found."""

    message: Message
    cure: Cure | None = None
    """What would change it; its call is the advice."""
    advice: Message | None = None
    """The advice where no call makes the cure."""
    effect: Effect | None = None
    share: float | None = None
    """The effect over what is normal for it; the size, if it is None."""
    reason: str | None = None
    other: str | None = None
    level: Level | None = None
    """The level where it is not the rule's."""


class Worst:
    """The worst of a subject: its numbers, and who it is, as attributes.

    `size`, `count`, `first` and `last` step; of joints `joint`, `link`, `unit`, `effort`, and how
    many `joints` of the body it holds for.
    """

    def __init__(self, noted: Noted, **about: object) -> None:
        self.size, self.count = noted.most, noted.count
        self.first, self.last = noted.first, noted.last
        self.__dict__ |= noted.at | about

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the rule noted
        raise AttributeError(f"the rule noted no {name}")


@dataclass(eq=False)
class Rule:
    """One rule: its matches in a table, its words, and what `drop explain` says of it."""

    code: str
    level: Level
    matches: Callable[[Any], Match]
    least_count: int = 1
    """Least number of steps in which it holds."""
    reason: str | None = None
    """Which of the code's causes it is."""
    words: Callable[[Worst], Said | None] = lambda _: None

    @property
    def meaning(self) -> str:
        """What the code means, in a sentence."""
        return (self.matches.__doc__ or "").strip()

    def says(self, words: Callable[[Worst], Said | None]) -> Callable[[Worst], Said | None]:
        """Take what is said of the worst; None if nothing is."""
        self.words = words
        return words

    def finding(self, worst: Worst, noted: Noted, **about: Any) -> Finding | None:  # noqa: ANN401
        """Return what is found of a subject; None if nothing is said of it."""
        said = self.words(worst)
        if said is None:
            return None
        return Finding(
            code=self.code,
            level=said.level or self.level,
            reason=said.reason or self.reason,
            message=said.message,
            advice=said.advice if said.cure is None else said.cure.call,
            cure=said.cure,
            effect=said.effect,
            share=worst.size if said.share is None else said.share,
            steps=noted.span,
            other=said.other,
            **about,
        )


JOINT_RULES: list[Rule] = []


def joint_rule(
    code: str, level: Level, *, least_count: float = 1, reason: str | None = None
) -> Callable[[Callable[[JointColumns], Match]], Rule]:
    """Make a function from joints to a match a rule: of each robot its worst joint is told."""

    def made(matches: Callable[[JointColumns], Match]) -> Rule:
        rule = Rule(code, level, matches, int(least_count), reason)
        JOINT_RULES.append(rule)
        return rule

    return made


class JointColumns:
    """The joints of a body in n of its steps: columns of shape (n, joint_rates).

    What `Driven` and what calls asked for hold, by name, and some that rules share.
    """

    def __init__(self, driven: Driven) -> None:
        self.driven, self.asked = driven, driven.asked
        law, shape = driven.steps.law, driven.asked.target.shape
        self.lower, self.upper = (np.broadcast_to(each, shape) for each in (law.lower, law.upper))
        self.target = target_of(driven)
        """Position that is asked for; nan where none is."""
        self.rate_before = driven.steps.before.velocity[:, driven.steps.law.tree.first_rate :]
        pd = self.asked.pd == 1
        self.motor = (self.asked.force > 0) & ~pd
        """Whether a call set a motor that may push."""
        self.position_motor = (self.asked.mode == POSITION) & (self.asked.impulse > 0) & ~pd
        units = [units_of(driven, k)[0] for k in range(shape[1])]
        self.at_target = np.array([AT_TARGET_M if unit == "m" else AT_TARGET_RAD for unit in units])
        """Gap below which each joint is at its target, shape (joint_rates,)."""

    def of_joints(self, number: Callable[[Joint], float]) -> Float64:
        """Return a number of each joint as a column, the same in all steps."""
        body = self.driven.body
        values = np.empty(self.asked.target.shape[1])
        for joint, place in zip(body.joints, body.rates, strict=True):
            values[place] = number(joint)
        return np.broadcast_to(values, self.asked.target.shape)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - a column of either
        return getattr(self.driven if hasattr(self.driven, name) else self.asked, name)


class JointRules(Answer):
    """Looks for all rules of joints in the joints of each body."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._noted: dict[tuple[int, int], Notes[int]] = {}
        """What is noted of the joints, by the place of a rule and the number of a body."""

    @np.errstate(all="ignore")  # what is not asked for is nan
    def see(self) -> None:
        """Take a piece."""
        for driven in self.scene.driven():
            joints = JointColumns(driven)
            for place, rule in enumerate(JOINT_RULES):
                match = rule.matches(joints)
                if match.where.any():
                    self._note(place, driven, match)

    def _note(self, place: int, driven: Driven, match: Match) -> None:
        notes = self._noted.setdefault((place, driven.body.number), Notes())
        numbers = {"site": driven.asked.site, **match.numbers}
        for k in np.flatnonzero(match.where.any(axis=0)).tolist():
            rows, link = np.flatnonzero(match.where[:, k]), link_of(driven.body, k)
            told = {
                name: np.broadcast_to(each, match.where.shape)[rows, k]
                for name, each in numbers.items()
            }
            unit, effort = units_of(driven, k)
            joint = driven.body.joints[link].name
            notes.add(
                k,
                driven.steps.steps[rows],
                match.size[rows, k],
                told,
                joint=joint,
                link=link,
                unit=unit,
                effort=effort,
            )

    def findings(self) -> Iterator[Finding]:
        """Yield what each rule says of the worst joint of each body."""
        for place, rule in enumerate(JOINT_RULES):
            for (which, number), notes in self._noted.items():
                found = [each for each in notes.values() if each.count >= rule.least_count]
                if which != place or not found:
                    continue
                noted = max(found, key=lambda each: (each.most, each.count))
                body = self.scene.body(number)
                worst = Worst(noted, joints=len(found), body=body)
                site = self.scene.site(noted.at["site"])
                finding = rule.finding(
                    worst, noted, body=body.label, joint=noted.at["joint"], site=site
                )
                if finding is not None:
                    yield finding

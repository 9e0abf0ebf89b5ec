"""Findings of a rule as data: rows with a condition, a sentence, a remedy and a level.

    weak.says(
        Row(
            says=Message("{joint} has a motor of {limit:N} in place of {force:N}"),
            cure=Remedy("force", "joint", "force"),
            effect="limit",
            unit="{effort}",
        )
    )

Of several rows the first that holds is said. Texts and remedies name numbers that the rule notes of
the worst (`Worst`); `{limit:N}` says of what kind a number is (`quantities.KINDS`), and `{call}` is
what the engine's user would write for the cure.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from string import Formatter
from typing import Any

from drop_physics.messages import Message
from drop_physics.quantities import KINDS, Written
from drop_physics.rules.answer import Cure, Effect, Level, Scene, Span, so_many
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import engine_of
from drop_physics.rules.runs import Runs
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body


@dataclass(frozen=True, kw_only=True)
class Said:
    """Finding about the worst case of a rule.

    What a text without values names is taken from `values`, or from the `Worst`; `{call}` is what
    the engine's user would write for the cure.
    """

    message: Message
    values: Mapping[str, object] = field(default_factory=dict)
    """Further values that texts name."""
    cure: Cure | None = None
    """The change that would cure it, which can be tried."""
    advice: Message | None = None
    """The advice, where the cure's call alone is not enough."""
    proposed: bool | None = None
    """Whether what is advised is only to be tried, where the rule does not say so for all."""
    effect: Effect | None = None
    share: float | None = None
    """The ratio of the effect to what is normal for it; the size, if it is None."""
    reason: str | None = None
    other: str | None = None
    level: Level | None = None
    """The level, where it is not the rule's."""
    code: str | None = None
    """The code, where it is not the rule's."""
    steps: Span | None = None
    """The steps of the finding, where these are not those in which the rule holds."""
    site: str | None = None
    """File and line, where the rule names no argument or call that is the cause."""
    call: Call | None = None
    """The call that is the cause."""
    subject: Body | None = None
    """The body, for a rule of inputs."""
    joint: str | None = None
    """The joint, where the table is not one of joints."""

    @property
    def body(self) -> str | None:
        """The name of the body."""
        return None if self.subject is None else self.subject.label


class Worst:
    """The worst case of a subject: its numbers, and its names, as attributes.

    `size`, `count`, `first` and `last` step, and what the rule noted; `among`, how many of its kind
    the subject has that are not ten times smaller; labels of the `body` and of
    the `other`, and both as they are, `subject` and `partner`; of joints `joint`, `link`, `unit`,
    `effort`, and how many `joints` of the body it holds for; of actuators `actuator` and
    its `joint`.
    """

    size: float
    count: int
    first: int
    last: int
    unit, effort = "m", "N"

    def __init__(self, scene: Scene, noted: Runs, **about: object) -> None:
        self.scene, self.noted = scene, noted
        self.__dict__ |= {name: each[:1].tolist()[0] for name, (_, each) in noted.columns.items()}
        self.subject: Body = scene.body(int(noted.keys[0, 0]))
        self.body = self.subject.label
        self.__dict__ |= about

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the rule noted
        raise AttributeError(f"the rule noted no {name}")

    @property
    def span(self) -> Span:
        """The steps in a finding's form; for a target, the first and last step of `stood`."""
        if (stood := vars(self).get("stood")) is not None:
            return Span(stood[0], stood[1], stood[1] - stood[0] + 1)
        first, last = vars(self).get("within", (-self.first, self.last))
        return Span(-first, last, self.count)

    @property
    def engine(self) -> str:
        """The engine that stepped the body, which decides the words of the texts."""
        return engine_of(self.scene.seen)

    @property
    def body_size_m(self) -> float:
        """The size of its body."""
        return size_m(self.subject)

    @property
    def steps(self) -> str:
        """The number of steps, as text."""
        return so_many(self.count)

    def time_s(self, step: int) -> float:
        """Return the time of a step in its simulation."""
        return self.scene.times[self.subject.client].of(step)


@dataclass(frozen=True)
class Remedy:
    """A cure whose target and numbers are those noted by a rule, by their names."""

    name: str
    target: str | None = None
    """What of the worst is changed: `joint`, `body`, `other`; None if it is the whole run."""
    value: float | str | None = None
    form: str = ""
    given: Mapping[str, float | str] | str = field(default_factory=dict)
    """Further numbers, by argument; or the name of all of them."""
    bodies: tuple[str, ...] = ()

    @property
    def blank(self) -> Cure:
        """The cure with nan for numbers that depend on the run."""
        given = {} if isinstance(self.given, str) else self.given
        value = None if self.value is None else math.nan
        return Cure(self.name, None, value, form=self.form, given=dict.fromkeys(given, math.nan))

    def of(self, worst: Worst) -> Cure:
        """Return the cure of a finding."""

        def number(named: float | str) -> Any:  # noqa: ANN401 - as the rule noted it
            return getattr(worst, named) if isinstance(named, str) else named

        return Cure(
            self.name,
            None if self.target is None else getattr(worst, self.target),
            None if self.value is None else number(self.value),
            form=self.form,
            given=number(self.given)
            if isinstance(self.given, str)
            else {name: number(each) for name, each in self.given.items()},
            bodies=tuple(getattr(worst, each) for each in self.bodies),
        )


@dataclass(frozen=True, kw_only=True)
class SayingRow:
    """A sentence about the worst case with its condition, and the change that would cure it."""

    when: Callable[[Worst], object] | None = None
    """The condition; None for always."""
    says: Message | None = None
    why: Message | None = None
    """The part of the sentence that rows differ in."""
    advice: Message | None = None
    """The advice, where the cure's call alone is not enough."""
    cure: Remedy | None = None
    proposed: bool | None = None
    effect: str | None = None
    """The number that is the magnitude."""
    unit: str | None = None
    """The unit of the magnitude, where it is not that of the joint's position."""
    share: str | float | None = None
    """The number that ranks it; the size, if it is None."""
    reason: str | None = None
    level: Level | None = None
    code: str | None = None
    site: str | None = None
    """The name of the file and line, where the rule names no argument or call."""
    other: str | None = None
    """The name of the label of the other body."""

    def like(self, row: SayingRow) -> SayingRow:
        """Return this row, with its missing parts taken from another."""
        left = (each.name for each in fields(self) if getattr(self, each.name) is None)
        return replace(self, **{name: getattr(row, name) for name in left})

    def said(self, worst: Worst) -> Said:
        """Return the row's sentence about the worst case."""
        effect = None
        if self.effect is not None:
            unit = (self.unit or "{unit}").format_map(_Named(worst))
            effect = Effect(abs(getattr(worst, self.effect)), unit)
        return Said(
            message=self.says or Message(""),
            values={} if self.why is None else {"why": self.why},
            cure=None if self.cure is None else self.cure.of(worst),
            advice=self.advice,
            proposed=self.proposed,
            effect=effect,
            share=getattr(worst, self.share) if isinstance(self.share, str) else self.share,
            reason=self.reason,
            level=self.level,
            code=self.code,
            site=None if self.site is None else getattr(worst, self.site),
            other=None if self.other is None else getattr(worst, self.other),
        )


class _Named(dict[str, object]):
    """The names that a template may use for the worst case."""

    def __init__(self, worst: object) -> None:
        self._worst = worst

    def __missing__(self, name: str) -> object:
        return getattr(self._worst, name)


def filled(text: str, values: Mapping[str, object], about: object) -> str:
    """Return a text with its names replaced by values or attributes.

    Numbers are written by their kinds, and texts among them filled likewise.
    """
    if not isinstance(text, Message) or text.values:
        return text
    held: dict[str, Any] = {}
    for _, name, kind, _ in Formatter().parse(text.template):
        if name:
            value: Any = values[name] if name in values else getattr(about, name)
            if kind and kind in KINDS:
                units = getattr(about, "unit", "m"), getattr(about, "effort", "N")
                value = Written(KINDS[kind](value, *units))
            held[name] = filled(value, values, about) if isinstance(value, str) else value
    return Message(text.template, **held)

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
the worst (`Worst`), in its table or in a function of its own:

    @weak.notes
    def _(force: float, limit: float) -> dict[str, object]: ...

`{limit:N}` says of what kind a number is (`quantities.KINDS`), and `{call}` is
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
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body

Noted = dict[str, object]
"""Further numbers and texts of the worst, by name."""


@dataclass(frozen=True, kw_only=True)
class Said:
    """Finding about the worst case of a rule.

    The names in a text without values are taken from `values`, or from the `Worst`; `{call}` is the
    cure as the engine's user would write it.
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

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401
        return {"unit": "m", "effort": "N"}.get(name) or getattr(self, name)


class Worst:
    """The worst of a subject: its numbers, and who it is, by their names.

    `size`, `count`, `first` and `last` step, and what the rule noted; `among`, how many of its kind
    the subject has that are not ten times smaller; labels of the `body` and of
    the `other`, and both as they are, `subject` and `partner`; of joints `joint`, `link`, `unit`,
    `effort`, and how many `joints` of the body it holds for; of actuators `actuator`, its `name`
    and its `joint`.
    """

    def __init__(self, scene: Scene, noted: Runs, **about: object) -> None:
        self.scene, self.noted = scene, noted
        self.subject: Body = scene.body(int(noted.keys[0, 0]))
        row = {name: each[:1].tolist()[0] for name, (_, each) in noted.columns.items()}
        self.values: dict[str, Any] = {"unit": "m", "effort": "N"} | row
        self.values |= {"body": self.subject.label} | about

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401 - whatever the rule noted
        return self.values[name] if name in self.values else getattr(self, name)

    @property
    def keys(self) -> list[int]:
        """The numbers of what it is about."""
        found: list[int] = self.noted.keys[0].tolist()
        return found

    @property
    def span(self) -> Span:
        """The steps as a finding says them; for a target, the first and last step of `stood`."""
        if (stood := self.values.get("stood")) is not None:
            return Span(stood[0], stood[1], stood[1] - stood[0] + 1)
        first, last = self.values.get("within", (-self["first"], self["last"]))
        return Span(-first, last, self["count"])

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
        return so_many(self["count"])

    def time_s(self, step: int) -> float:
        """Return the time of a step in its simulation."""
        return self.scene.times[self.subject.client].of(step)


@dataclass(frozen=True)
class Remedy:
    """A cure whose target and numbers are those noted by a rule, by their names."""

    name: str
    target: str | None = None
    """Target of the cure: `joint`, `body`, `other`; None for the whole run."""
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
            return worst[named] if isinstance(named, str) else named

        return Cure(
            self.name,
            None if self.target is None else worst[self.target],
            None if self.value is None else number(self.value),
            form=self.form,
            given=number(self.given)
            if isinstance(self.given, str)
            else {name: number(each) for name, each in self.given.items()},
            bodies=tuple(worst[body] for body in self.bodies),
        )


@dataclass(frozen=True, kw_only=True)
class SayingRow:
    """Finding about the worst case where a condition holds, and the change that would cure it.

    Sentence, advice, cure, reason, level, and whether it is only to be tried, are what the rule
    notes under these names, where a row leaves them out.
    """

    when: Callable[..., object] | None = None
    """The condition, a function of what its parameters name; None for always."""
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
    normal: str | float | None = None
    """What is normal for the magnitude: their ratio ranks it."""
    least: str | None = None
    """The number that the share is above, or nothing is said."""
    reason: str | None = None
    level: Level | None = None
    code: str | None = None
    site: str | Act | None = None
    """The name of the file and line, where the rule names no argument or call; or the act of the
    only line that is meant."""

    def like(self, row: SayingRow) -> SayingRow:
        """Return this row, with what it leaves out taken from another."""
        left = (each.name for each in fields(self) if getattr(self, each.name) is None)
        return replace(self, **{name: getattr(row, name) for name in left})

    def said(self, worst: Worst) -> Said | None:
        """Return the row's sentence about the worst case."""
        noted, effect = worst.values, None
        share = worst[self.share] if isinstance(self.share, str) else self.share
        if self.effect is not None:
            size, unit = abs(float(worst[self.effect])), self.unit or "{unit}"
            effect = Effect(size, unit.format_map(worst))
            if self.normal is not None:
                share = size / (worst[self.normal] if isinstance(self.normal, str) else self.normal)
        if self.least is not None and not share > worst[self.least]:
            return None
        site = self.site
        return Said(
            message=self.says or noted["says"],
            values={} if self.why is None else {"why": self.why},
            cure=noted.get("cure") if self.cure is None else self.cure.of(worst),
            advice=self.advice or noted.get("advice"),
            proposed=noted.get("proposed") if self.proposed is None else self.proposed,
            effect=effect,
            share=share,
            reason=self.reason or noted.get("reason"),
            level=self.level or noted.get("level"),
            code=self.code,
            site=worst.scene.only_site(site) if isinstance(site, Act) else site and worst[site],
        )


def filled(text: str, values: Mapping[str, object], about: Worst | Said) -> str:
    """Return a text with what it names, taken from some values or from what it is about.

    Numbers are written by their kinds, and texts among them filled likewise.
    """
    if not isinstance(text, Message) or text.values:
        return text
    held: dict[str, Any] = {}
    for _, name, kind, _ in Formatter().parse(text.template):
        if name:
            value: Any = values[name] if name in values else about[name]
            if kind and kind in KINDS:
                value = Written(KINDS[kind](value, about["unit"], about["effort"]))
            held[name] = filled(value, values, about) if isinstance(value, str) else value
    return Message(text.template, **held)

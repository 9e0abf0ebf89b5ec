"""The rows of a rule: conditions with the message and the suggested change of each.

    weak.says(
        Row(
            says=Message("{joint} has a motor of {limit:N} in place of {force:N}"),
            cure=Remedy("force", "joint", "force"),
            effect="limit",
            unit="{effort}",
        )
    )

A rule reports its first row whose condition holds. Texts and remedies refer by name to numbers of
the worst match (`Worst`): columns of the rule's table, or results of a function of the rule:

    @weak.notes
    def _(force: float, limit: float) -> dict[str, object]: ...

`{limit:N}` gives the kind of a number (`quantities.KINDS`), and `{call}` is the call or statement
that a user of the engine would write for the cure.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from string import Formatter
from typing import Any

from drop_physics.account.rows import AccountRow
from drop_physics.messages import Message
from drop_physics.quantities import KINDS, Written
from drop_physics.rules.answer import SCENE_TABLES, Cure, Effect, Finding, Scene, Span, so_many
from drop_physics.rules.arguments import site_of
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.codes import Level
from drop_physics.rules.engines import engine_of
from drop_physics.rules.runs import Runs
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body

Noted = dict[str, object]
"""Further numbers and texts about a rule's worst match, by name."""


@dataclass(kw_only=True)
class Case:
    """A match of a rule: the body or joint it is about, with named numbers and texts.

    A rule about calls yields cases, with the `values` that its rows name.
    """

    subject: Body | None = None
    values: dict[str, Any] = field(default_factory=dict)
    span: Span | None = None
    """The steps in which the rule holds."""
    call: Call | None = None
    """The call that caused the problem."""
    site: str | None = None
    """File and line of the cause, if the cause is not a call."""
    scene: Scene = field(init=False, repr=False)
    """The scene, whose tables the rule's functions may also name as parameters."""

    def __post_init__(self) -> None:
        about = {"body": self.label, "size": 0.0}
        self.values = (
            {"unit": "m", "effort": "N", "joint": None, "other": None} | about | self.values
        )
        if self.call is not None:
            self.site = site_of(self.call)

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401 - whatever the rule noted
        if name in self.values:
            return self.values[name]
        return getattr(self.scene if name in SCENE_TABLES else self, name)

    @property
    def label(self) -> str | None:
        """The name of the body that the match is about."""
        return None if self.subject is None else self.subject.label

    @staticmethod
    def of_row(row: AccountRow) -> Case:
        """Convert a row of the account to a case of a rule."""
        about: dict[str, Any] = {name: getattr(row, name) for name in ("cause", "joint", "other")}
        about["unit"] = row.unit or "m"
        about["effort"] = "N m" if about["unit"].startswith("rad") else "N"
        values = {"size": row.got, **about, **row.noted}
        span = None if row.span is None else Span(*row.span)
        call = row.noted.get("call")
        return Case(subject=row.subject, values=values, span=span, call=call, site=row.site)

    def held(self) -> Span | None:
        """Return the steps that the finding covers."""
        return self.span


class Worst(Case):
    """The worst match for one body or joint, with named numbers.

    The names are `size`, `count`, `first` and `last` (steps), and the names that the rule noted;
    `among`, the number of the subject's matches that are at least a tenth as large; `body` and
    `other`, the labels of both bodies, and `subject` and `partner`, the bodies themselves. Rules on
    joints also have `joint`, `link`, `unit`, `effort`, and `joints`, the number of the body's
    joints for which the rule holds, with `others`, the same as ` (and 3 more)`; rules on
    actuators have `actuator`, with its `name` and `joint`.
    """

    subject: Body

    def __init__(self, scene: Scene, noted: Runs, site: str | None, **about: object) -> None:
        self.scene, self.noted = scene, noted
        row = {name: each[:1].tolist()[0] for name, (_, each) in noted.columns.items()}
        subject = scene.seen.bodies[int(noted.keys[0, 0])]
        super().__init__(subject=subject, values=row | about, site=site)

    @property
    def keys(self) -> list[int]:
        """The ids that the match is about, such as body and joint."""
        found: list[int] = self.noted.keys[0].tolist()
        return found

    def held(self) -> Span:
        """Return the steps that the finding covers; for a target, the steps with it in effect."""
        if (stood := self.values.get("stood")) is not None:
            return Span(stood[0], stood[1], stood[1] - stood[0] + 1)
        first, last = self.values.get("within", (-self["first"], self["last"]))
        return Span(-first, last, self["count"])

    @property
    def engine(self) -> str:
        """The engine that stepped the body."""
        return engine_of(self.scene.seen)

    @property
    def body_size_m(self) -> float:
        """The size of the body that the match is about [m]."""
        return size_m(self.subject)

    @property
    def steps(self) -> str:
        """The number of steps, as text."""
        return so_many(self["count"])

    def time_s(self, step: int) -> float:
        """Convert a step to the simulated time of the body's simulation."""
        return self.scene.times[self.subject.client].of(step)


@dataclass(frozen=True)
class Remedy:
    """A suggested change, given by the names of the numbers that a rule recorded."""

    name: str
    target: str | None = None
    """Target of the cure: `joint`, `body`, `other`; None for the whole run."""
    value: float | str | None = None
    form: str = ""
    given: Mapping[str, float | str] | str = field(default_factory=dict)
    """Further numbers, by argument; or the single name under which all of them are recorded."""
    bodies: tuple[str, ...] = ()

    @property
    def blank(self) -> Cure:
        """The suggested change, with nan for numbers that depend on the run."""
        given = {} if isinstance(self.given, str) else self.given
        value = None if self.value is None else math.nan
        return Cure(self.name, None, value, form=self.form, given=dict.fromkeys(given, math.nan))

    def of(self, case: Case) -> Cure | None:
        """Return the suggested change for a case; None if its value is nan: no value would help."""

        def number(named: float | str) -> Any:  # noqa: ANN401 - as the rule noted it
            return case[named] if isinstance(named, str) else named

        value = None if self.value is None else number(self.value)
        if isinstance(value, float) and math.isnan(value):
            return None
        return Cure(
            self.name,
            None if self.target is None else case[self.target],
            value,
            form=self.form,
            given=number(self.given)
            if isinstance(self.given, str)
            else {name: number(each) for name, each in self.given.items()},
            bodies=tuple(case[body] for body in self.bodies),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class SayingRow:
    """One possible message of a rule: condition, text, suggested change, and level.

    If a row leaves out sentence, advice, cure, reason, level, or whether its advice is only a
    proposal, or its cure's value is nan, the rule's noted values of the same names are used.
    """

    when: Callable[..., object] | None = None
    """The condition, a function of the values that its parameters name; None for always."""
    says: Message | None = None
    why: Message | None = None
    """The part of the sentence in which a rule's rows differ."""
    advice: Message | None = None
    """The advice, if the cure's call alone does not suffice."""
    cure: Remedy | None = None
    proposed: bool | None = None
    effect: str | None = None
    """The name of the number that is the magnitude."""
    unit: str | None = None
    """The unit of the magnitude, if it is not that of the joint's position."""
    share: str | float | None = None
    """The number that ranks the finding; None to use the size."""
    normal: str | float | None = None
    """The normal size of the magnitude: their ratio ranks the finding."""
    least: str | None = None
    """The name of the number that the share must exceed; otherwise nothing is reported."""
    reason: str | None = None
    level: Level | None = None
    code: str | None = None
    engines: tuple[str, ...] | None = None
    """The engines to which the row applies, if these are fewer than the rule's."""
    site: str | Act | None = None
    """The name of the file and line, if the rule does not name an argument or call; or the kind of
    call, if only one line makes such calls."""

    def like(self, row: SayingRow) -> SayingRow:
        """Return this row, with its missing fields taken from another row."""
        left = (each.name for each in fields(self) if getattr(self, each.name) is None)
        return replace(self, **{name: getattr(row, name) for name in left})

    def finding(self, case: Case, scene: Scene, plain: Finding) -> Finding | None:
        """Return the finding about a case; `plain` has what the rule says of all its findings."""
        noted, effect = case.values, None
        share = case["size"] if self.share is None else self.share
        share = case[share] if isinstance(share, str) else share
        if self.effect is not None:
            size, unit = abs(float(case[self.effect])), self.unit or "{unit}"
            effect = Effect(size, unit.format_map(case))
            if self.normal is not None:
                share = size / (case[self.normal] if isinstance(self.normal, str) else self.normal)
        if self.least is not None and not share > case[self.least]:
            return None
        cure = (self.cure and self.cure.of(case)) or noted.get("cure")
        if cure is not None:
            cure = replace(cure, call=cure.call or scene.call_of(cure))
            noted["call"] = cure.call
        if self.why is not None:
            noted["why"] = self.why
        advice = self.advice or noted.get("advice") or (cure and cure.call)
        proposed = noted.get("proposed") if self.proposed is None else self.proposed
        proposed = plain.proposed if proposed is None else proposed
        site = self.site
        return replace(
            plain,
            code=self.code or plain.code,
            level=self.level or noted.get("level") or plain.level,
            reason=self.reason or noted.get("reason") or plain.reason,
            message=filled(self.says or noted["says"], case),
            advice=filled(advice, case) if advice else None,
            proposed=proposed,
            proof="none" if proposed else plain.proof,
            cure=cure,
            joint=noted["joint"],
            other=noted["other"],
            effect=effect,
            share=float(share or 0.0),
            steps=case.held(),
            site=(scene.only_site(site) if isinstance(site, Act) else site and case[site])
            or case.site,
        )


def filled(text: str, case: Case) -> str:
    """Fill in a text's placeholders with values of the case.

    Numbers are formatted by their kind; texts among the values are filled in the same way.
    """
    if not isinstance(text, Message) or text.values:
        return text
    held: dict[str, Any] = {}
    for _, name, kind, _ in Formatter().parse(text.template):
        if name:
            value = case[name]
            if kind and kind in KINDS:
                value = Written(KINDS[kind](value, case["unit"], case["effort"]))
            held[name] = filled(value, case) if isinstance(value, str) else value
    return Message(text.template, **held)

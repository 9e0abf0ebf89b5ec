"""The rows of a rule: conditions with the message and the suggested change of each.

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

from drop_physics.account.rows import AccountRow
from drop_physics.messages import Message
from drop_physics.quantities import KINDS, Written
from drop_physics.rules.answer import SCENE_TABLES, Cure, Effect, Level, Scene, Span, so_many
from drop_physics.rules.arguments import site_of
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import engine_of
from drop_physics.rules.runs import Runs
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body

Noted = dict[str, object]
"""Further numbers and texts about the worst case, by name."""


@dataclass(frozen=True, kw_only=True)
class Said:
    """The message that a rule gives about its worst case.

    The names in a text without values are taken from `values`, or from the `Worst`; `{call}` is the
    cure as the engine's user would write it.
    """

    message: Message
    values: Mapping[str, object] = field(default_factory=dict)
    """Further values to fill into the texts."""
    cure: Cure | None = None
    """The change that would fix the problem, as an intervention that can be tried."""
    advice: Message | None = None
    """The advice, if the cure's call alone does not suffice."""
    proposed: bool | None = None
    """Whether the advice is only a proposal; None to use the rule's own setting."""
    effect: Effect | None = None
    share: float | None = None
    """The ratio of the effect to its normal size; None to use the size."""
    reason: str | None = None
    other: str | None = None
    level: Level | None = None
    """The level, if it differs from the rule's."""
    code: str | None = None
    """The code, if it differs from the rule's."""
    steps: Span | None = None
    """The steps of the finding, if they differ from those in which the rule holds."""
    site: str | None = None
    """File and line, if the rule does not name an argument or call as the cause."""
    subject: Body | None = None
    joint: str | None = None

    @property
    def body(self) -> str | None:
        """The name of the body."""
        return None if self.subject is None else self.subject.label

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401
        return {"unit": "m", "effort": "N"}.get(name) or getattr(self, name)


@dataclass(kw_only=True)
class Case:
    """A match of a rule: the body or joint it is about, with named numbers and texts.

    A rule of calls yields each with the `values` that its rows name.
    """

    subject: Body | None = None
    values: dict[str, Any] = field(default_factory=dict)
    span: Span | None = None
    """The steps in which it holds."""
    call: Call | None = None
    """The call that is the cause."""
    site: str | None = None
    """File and line of the cause, if that is no call."""
    scene: Scene = field(init=False, repr=False)
    """The tables that the rule's functions may name, too."""

    def __post_init__(self) -> None:
        about = {"body": None if self.subject is None else self.subject.label, "size": 0.0}
        self.values = (
            {"unit": "m", "effort": "N", "joint": None, "other": None} | about | self.values
        )
        if self.call is not None:
            self.site = site_of(self.call)

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401 - whatever the rule noted
        if name in self.values:
            return self.values[name]
        return getattr(self.scene if name in SCENE_TABLES else self, name)

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

    `size`, `count`, `first` and `last` step, and what the rule noted; `among`, how many of its kind
    the subject has that are not ten times smaller; labels of the `body` and of
    the `other`, and both as they are, `subject` and `partner`; of joints `joint`, `link`, `unit`,
    `effort`, and how many `joints` of the body it holds for; of actuators `actuator`, its `name`
    and its `joint`.
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
        """Return the steps that the finding covers; for a target, those it was in effect."""
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
        """Return the suggested change for a case; None if its number is nan: no value will do."""

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

    Sentence, advice, cure, reason, level, and whether it is only to be tried, are what the rule
    notes under these names, where a row leaves them out or does not know its cure's number.
    """

    when: Callable[..., object] | None = None
    """The condition, a function of the values that its parameters name; None for always."""
    says: Message | None = None
    why: Message | None = None
    """The part of the sentence in which rows differ."""
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
    """The engines whose words the row has, if those of the rule are more."""
    site: str | Act | None = None
    """The name of the file and line, if the rule does not name an argument or call; or the kind of
    call, if only one line makes such calls."""

    def like(self, row: SayingRow) -> SayingRow:
        """Return this row, with its missing fields taken from another row."""
        left = (each.name for each in fields(self) if getattr(self, each.name) is None)
        return replace(self, **{name: getattr(row, name) for name in left})

    def said(self, case: Case, scene: Scene) -> Said | None:
        """Return the message about a case, with its suggested change."""
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
        site = self.site
        return Said(
            message=self.says or noted["says"],
            values={} if self.why is None else {"why": self.why},
            cure=(self.cure and self.cure.of(case)) or noted.get("cure"),
            advice=self.advice or noted.get("advice"),
            proposed=noted.get("proposed") if self.proposed is None else self.proposed,
            effect=effect,
            share=share,
            reason=self.reason or noted.get("reason"),
            level=self.level or noted.get("level"),
            code=self.code,
            steps=case.held(),
            subject=case.subject,
            joint=noted["joint"],
            other=noted["other"],
            site=(scene.only_site(site) if isinstance(site, Act) else site and case[site])
            or case.site,
        )


def filled(text: str, values: Mapping[str, object], about: Case | Said) -> str:
    """Fill in a text's placeholders with values, or with values of the case.

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

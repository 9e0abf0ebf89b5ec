"""The rows of an account: one thing asked, given, moved or held, with the terms that made it so."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Literal, get_args

from drop_physics.trace.events import Body

Kind = Literal[
    "asked", "given", "moved", "turned", "held", "set", "press", "slips", "energy", "reads", "idle"
]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""The kinds of rows: what a script asked a joint or a constraint for; what it gave, as a torque or
a control; what moved or turned though nothing commanded it; what was pushed and did not move;
states that the script wrote; links that press each other, and that slip; energy given and taken;
readings; and what could have acted and did not."""


@dataclass(frozen=True, kw_only=True)
class RowTerm:
    """A term of the sum, in a row."""

    cause: str
    """The cause: `gravity`, `motors`, `contact`, `friction`, `drag` …"""
    words: str
    """The cause and its partner, as readers see them."""
    body: str | None = None
    """Label of the partner's body, in a contact."""
    link: str | None = None
    """Name of the partner's link in a contact, or of the joint whose acceleration drags."""
    value: float
    """Mean force [N] or torque [N m] over the row's moment, or work [J] up to it."""
    unit: str
    towards: bool
    """Whether it acts towards what was asked, or gave the motion or energy."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the account."""

    kind: Kind
    body: str | None
    """Label of the body that it is about."""
    joint: str | None = None
    link: str | None = None
    pair: tuple[str, str] | None = None
    """The two links that touch, or should."""
    constraint: str | None = None
    actuator: str | None = None
    site: str | None = None
    """File and line of the call or the reading that it is about."""
    told: str
    """The row as a sentence, without its subject and its terms."""
    asked: float | None = None
    got: float | None = None
    gap: float | None = None
    """Got minus asked."""
    unit: str | None = None
    step: int | None = None
    """The sample that the row's moment ends with."""
    time_s: float | None = None
    at_limit: bool = False
    """Whether the drive is at its limit at that moment."""
    terms: tuple[RowTerm, ...] = ()
    """The terms at that moment, the largest first."""
    salience: float = 0.0
    """The measure by which rows are ranked; of no meaning besides."""
    alike: int = 0
    """How many further bodies or joints it stands for."""
    subject: Body | None = field(default=None, repr=False)
    """The body itself."""
    group: Hashable = field(default=None, repr=False)
    """Rows of equal groups are alike: the first stands for all."""

    @property
    def who(self) -> str:
        """The name of what the row is about."""
        if self.pair is not None:
            return " × ".join(self.pair)
        named = self.joint or self.constraint or self.actuator or self.link or self.body
        return named or self.site or ""

    @property
    def towards(self) -> tuple[RowTerm, ...]:
        """The terms that act towards what was asked, or gave."""
        return tuple(each for each in self.terms if each.towards)

    @property
    def against(self) -> tuple[RowTerm, ...]:
        """The terms that act against it, or took."""
        return tuple(each for each in self.terms if not each.towards)

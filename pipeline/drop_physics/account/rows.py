"""The rows of an account: one thing asked, given, moved or held, with the terms behind it."""

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
    """Label of the partner's body, in a contact or a constraint."""
    link: str | None = None
    """Name of the partner's link, likewise, or of the joint whose acceleration drags."""
    value: float
    """Mean force [N] or torque [N m] over the row's moment, or work [J] up to it."""
    unit: str
    """The unit of the value."""
    towards: bool
    """Whether it acts towards what was asked, or gave the motion or energy."""


@dataclass(frozen=True, kw_only=True)
class AccountRow:
    """One line of the account."""

    kind: Kind
    """`asked`, `given`, `moved`, `turned`, `held`, `set`, `press`, `slips`, `energy`, `reads` or
    `idle`."""
    body: str | None = None
    """Label of the body that it is about."""
    joint: str | None = None
    """Name of the joint, with its axis where it has three."""
    link: str | None = None
    """Name of the link."""
    pair: tuple[str, str] | None = None
    """The two links that touch, or should."""
    constraint: str | None = None
    """Name of the constraint or equality, or of the links that it holds."""
    actuator: str | None = None
    """Name of the actuator."""
    site: str | None = None
    """File and line of the call or the reading that it is about."""
    told: str
    """The row as a sentence, without its subject and its terms."""
    asked: float | None = None
    """The number that was asked for, or given."""
    got: float | None = None
    """The number that came."""
    gap: float | None = None
    """Got minus asked."""
    unit: str | None = None
    """The unit of these numbers, in SI."""
    step: int | None = None
    """The sample that the row's moment ends with."""
    time_s: float | None = None
    """Simulated time of that sample."""
    at_limit: bool = False
    """Whether the drive is at its limit at that moment."""
    terms: tuple[RowTerm, ...] = ()
    """The terms at that moment, the largest first."""
    salience: float = 0.0
    """The measure by which rows are ranked; of no meaning besides."""
    alike: int = 0
    """Number of further bodies or joints that the row stands for."""
    subject: Body | None = field(default=None, repr=False, metadata={"json": False})
    """The body itself."""
    other: str | None = field(default=None, repr=False, metadata={"json": False})
    """Label of the other body of a pair."""
    besides: tuple[tuple[float, str], ...] = field(default=(), repr=False, metadata={"json": False})
    """The further numbers that its sentence tells, with their units."""
    joints: tuple[str, ...] = field(default=(), repr=False, metadata={"json": False})
    """The further joints of the same body that it stands for."""
    gives_j: float = field(default=0.0, repr=False, metadata={"json": False})
    """Energy that the drive of its joint gave: rows of a body that moves raise those of what
    moves it."""
    misled: bool = field(default=False, repr=False, metadata={"json": False})
    """Whether it is of a control that is of another joint, late, of the wrong sign or cut off: told
    of a run that ended well, too."""
    group: Hashable = field(default=None, repr=False, metadata={"json": False})
    """Rows of equal groups are alike: the first stands for all."""

    @property
    def who(self) -> str:
        """The name of the row's subject."""
        if self.pair is not None:
            return " × ".join(self.pair)
        if self.site is not None:
            return self.site
        if self.subject is not None and self.subject.node_of:
            return self.subject.node_of
        named = self.joint or self.constraint or self.actuator or self.link or self.body
        return named or ""

    @property
    def numbers(self) -> tuple[tuple[float, str], ...]:
        """The numbers of the row, with their units."""
        pushed = self.asked if self.kind == "held" else None
        told = [(value, self.unit or "") for value in (self.got, self.gap, pushed)]
        return tuple((value, unit) for value, unit in (*told, *self.besides) if value)

    @property
    def towards(self) -> tuple[RowTerm, ...]:
        """The terms that act towards the target, or gave."""
        return tuple(each for each in self.terms if each.towards)

    @property
    def against(self) -> tuple[RowTerm, ...]:
        """The terms that act against it, or took."""
        return tuple(each for each in self.terms if not each.towards)

"""The rows of an account: what was requested, what resulted, and the terms between them."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from drop_physics.trace.events import Body

Kind = Literal[
    "asked", "given", "moved", "turned", "held", "set", "press", "slips", "energy", "reads", "idle"
]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""The kinds of rows: what a script requested of a joint or a constraint; what it applied, as a
torque or a control; what moved or turned without a command; what was pushed and did not move;
states that the script wrote; links that press each other, and that slip; energy given and taken;
readings; and bodies, forces or actuators that had no effect."""


@dataclass(frozen=True, kw_only=True)
class RowTerm:
    """A term of a row: a cause, with its force or energy."""

    cause: str
    """The cause: `gravity`, `motors`, `contact`, `friction`, `drag` …"""
    words: str
    """The displayed name of the cause and its partner."""
    body: str | None = None
    """Label of the partner's body, for a contact or a constraint."""
    link: str | None = None
    """Name of the partner's link, for a contact or a constraint, or of the joint whose acceleration
    couples to this one through the mass matrix."""
    value: float
    """Mean force [N] or torque [N m] over the row's moment, or work [J] up to that moment."""
    unit: str
    """The unit of the value."""
    towards: bool
    """Whether the term acts towards the request, or gave the motion or energy."""


@dataclass(frozen=True, kw_only=True)
class AccountRow:
    """One line of the account: a request or motion, its result, and the explaining terms."""

    kind: Kind
    """`asked`, `given`, `moved`, `turned`, `held`, `set`, `press`, `slips`, `energy`, `reads` or
    `idle`."""
    body: str | None = None
    """Label of the body that the row is about."""
    joint: str | None = None
    """Name of the joint, with the axis if it has three."""
    link: str | None = None
    """Name of the link."""
    pair: tuple[str, str] | None = None
    """The two links that touch, or should touch."""
    constraint: str | None = None
    """Name of the constraint or equality, or of the links that the constraint holds."""
    actuator: str | None = None
    """Name of the actuator."""
    site: str | None = None
    """File and line of the call or the reading that the row is about."""
    told: str
    """The row as a sentence, without the subject and the terms."""
    asked: float | None = None
    """The value that was requested, or applied."""
    got: float | None = None
    """The resulting value."""
    gap: float | None = None
    """The resulting value minus the requested one."""
    unit: str | None = None
    """The SI unit of these values."""
    step: int | None = None
    """The sample at the end of the row's moment."""
    time_s: float | None = None
    """Simulated time of that sample."""
    at_limit: bool = False
    """Whether the drive is at its limit at that moment."""
    terms: tuple[RowTerm, ...] = ()
    """The terms around that moment, in descending order of size: forces as the mean of the steps
    within 1 % of the run, at least two to either side."""
    mean: str = field(default="", repr=False, metadata={"json": False})
    """The steps over which the forces of the terms are averaged, as a text; empty for steady forces
    and for energies."""
    salience: float = 0.0
    """The measure by which rows are ranked; it has no other meaning."""
    alike: int = 0
    """Number of further bodies or joints that the row represents."""
    subject: Body | None = field(default=None, repr=False, metadata={"json": False})
    """The body itself."""
    other: str | None = field(default=None, repr=False, metadata={"json": False})
    """Label of the other body of a pair."""
    besides: tuple[tuple[float, str], ...] = field(default=(), repr=False, metadata={"json": False})
    """Further numbers in the row's sentence, with their units."""
    joints: tuple[str, ...] = field(default=(), repr=False, metadata={"json": False})
    """Further joints of the same body that the row represents."""
    gives_j: float = field(default=0.0, repr=False, metadata={"json": False})
    """Energy given by the drive of the row's joint, which raises the row if the body moves."""
    misled: bool = field(default=False, repr=False, metadata={"json": False})
    """Whether the row is about a control that follows another joint, is delayed, has the wrong sign
    or is cut off: reported even if the run ended well."""
    cause: str | None = field(default=None, repr=False, metadata={"json": False})
    """The cause as a word, by which rules find their remedy."""
    span: tuple[int, int, int] | None = field(default=None, repr=False, metadata={"json": False})
    """First and last sample of the steps in which the cause acts, and their number."""
    noted: Mapping[str, Any] = field(
        default_factory=dict, repr=False, compare=False, metadata={"json": False}
    )
    """Further numbers and names of the row, for the sentence and the remedy of a rule."""
    group: Hashable = field(default=None, repr=False, metadata={"json": False})
    """Key of similar rows: the first row with a key represents all."""

    @property
    def who(self) -> str:
        """The name of the body, joint or pair that the row is about."""
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
        """The quantities that the row is about, with units: of a target only the gap."""
        pushed = self.asked if self.kind == "held" else None
        got = self.got if self.kind != "asked" or self.gap is None else None
        told = [(value, self.unit or "") for value in (got, self.gap, pushed)]
        return tuple((value, unit) for value, unit in (*told, *self.besides) if value)

    @property
    def towards(self) -> tuple[RowTerm, ...]:
        """The terms that act in the direction of the target, or that gave energy."""
        return tuple(each for each in self.terms if each.towards)

    @property
    def against(self) -> tuple[RowTerm, ...]:
        """The terms that act against the target, or that took energy."""
        return tuple(each for each in self.terms if not each.towards)


def magnitude(number: float) -> int:
    """Return the order of magnitude of a number, by which similar rows are grouped."""
    size = np.clip(np.abs(np.nan_to_num(number, nan=1.0)), 1e-12, 1e12)
    return int(np.floor(np.log10(size) + 0.5))

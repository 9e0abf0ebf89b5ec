"""A cure as data: what a rule proposes, whatever the engine; and a run with it.

An engine's room writes the call that makes a cure (`words`) and the run in which it is made
(`interventions`); `engines.cures` finds both by the name of the engine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from drop_physics.trace.events import Body


@dataclass(frozen=True)
class Cure:
    """What would change it: an intervention, which a trial can make."""

    name: str
    """Of the intervention: `force`, `gains`, `timestep-first` …"""
    target: str | None = None
    """The body or joint that it is made on; None if on the whole run."""
    value: float | None = None
    """What is given; None where the intervention has no number."""
    call: str = field(default="", compare=False)
    """What its user would write; the engine writes it where a rule leaves it empty."""
    form: str = field(default="", metadata={"json": False})
    """Which way of making it is meant, where there are several."""
    given: Mapping[str, Any] = field(default_factory=dict, hash=False, metadata={"json": False})
    """What the call and the trial are given besides: numbers and names by argument."""
    bodies: tuple[str, ...] = field(default=(), metadata={"json": False})
    """Labels of the bodies that it is made on, where that is not the finding's own."""


@dataclass(frozen=True)
class Scope:
    """What an intervention is made on."""

    bodies: Sequence[Body]
    joint: str | None = None
    """The joint of the only body; None for all of its joints."""
    site: str | None = None
    """File and line of the call that a finding is about."""
    other: Body | None = None
    """The other body of a finding about two."""
    target: str | None = None
    """What a cure names: a body, a joint, an actuator."""
    commanded: frozenset[tuple[int, int]] = frozenset()
    """Numbers of bodies and links of the joints whose motors a call commands."""
    timestep_s: float = 1 / 240
    """The last one of the run."""
    whole: bool = False
    """Whether it is all of the run, because nothing else is named."""

    def links(self, body: Body) -> list[int]:
        """Return the joints that are meant, of those that move, by their links."""
        return [
            joint.link
            for joint in body.joints
            if joint.widths[0] and self.joint in (None, joint.name)
        ]


@dataclass(frozen=True)
class ChangedRun:
    """What a run does otherwise."""

    operations: list[dict[str, Any]] = field(default_factory=list)
    """The operations, as the engine's hooks take them."""
    below: dict[str, Any] = field(default_factory=dict)
    """What differs in the engine, unseen by the script: the arguments of a `Variation`, and
    `draws`, a seed in place of the script's own."""

    @property
    def finer(self) -> int:
        """Return the steps of the engine for each of the script's."""
        return int(self.below.get("finer", 1))

    def __add__(self, other: ChangedRun) -> ChangedRun:
        """Return a run that does both otherwise."""
        below = {**self.below, **other.below}
        if self.finer > 1 and other.finer > 1:
            below["finer"] = self.finer * other.finer
        return ChangedRun([*self.operations, *other.operations], below)


def whole_number(value: float) -> float:
    """Return a number as an engine takes it: one that is whole as an integer."""
    return int(value) if float(value).is_integer() else value


NUDGE = 1e-9
"""How far bodies and joints are moved before the first step [m, rad]."""
FACTOR, FACTORS = "factor", ("gravity", "friction", "mass")
"""The form of a cure whose value changes the whole run, and the names of those: a factor of all
friction or masses, or the magnitude of gravity [m/s2]."""
BELOW: dict[str, tuple[str, float | None]] = {
    "timestep": ("finer", 2),
    "iterations": ("iterations", 4),
    "nudge": ("nudge", NUDGE),
    "seed": ("draws", None),
}
"""Cures that any engine makes, unseen by the script; how a run names them, and what is given
without a value."""


def below(cure: Cure) -> ChangedRun | None:
    """Return a run in which any engine differs, unseen by the script; None of another cure."""
    if cure.form == FACTOR:
        return ChangedRun(below={cure.name: cure.value})
    if cure.name not in BELOW:
        return None
    name, usual = BELOW[cure.name]
    value = usual if cure.value is None else cure.value
    return ChangedRun(below={name: value if value is None or name == "nudge" else int(value)})


class EngineCures(Protocol):
    """What an engine's room knows of cures."""

    def call_of(self, cure: Cure) -> str:
        """Return the call or attribute that its user would write."""

    def applied(self, cure: Cure, scope: Scope) -> ChangedRun | None:
        """Return what a run with it does otherwise; None if the engine has none such."""

    def left_out(
        self, function: str, file: str, line: int, argument: str | None
    ) -> ChangedRun | None:
        """Return a run without a call, or without an argument of it; None if it cannot be."""

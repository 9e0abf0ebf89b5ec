"""A cure as data: the proposal of a rule, for any engine; and a run with it.

The table of interventions (`engines/…/interventions`) has the call that makes a cure, and the run
in which it is made; `engines.cures` finds it by the name of the engine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drop_physics.trace.events import Body


@dataclass(frozen=True)
class Cure:
    """A proposed change that a trial can make: an intervention with its target and value."""

    name: str
    """Name of the intervention: `force`, `gains`, `timestep-first` …"""
    target: str | None = None
    """The body or joint that is changed; None if it is the whole run."""
    value: float | None = None
    """The new value; None if the intervention has no number."""
    call: str = field(default="", compare=False)
    """The call that a user would write; the engine words it if a rule leaves it empty."""
    form: str = field(default="", metadata={"json": False})
    """Form of the intervention, if there are several."""
    given: Mapping[str, Any] = field(default_factory=dict, hash=False, metadata={"json": False})
    """Further numbers and names for the call and the trial, by argument."""
    bodies: tuple[str, ...] = field(default=(), metadata={"json": False})
    """Labels of the bodies that are changed, if they are not those of the finding."""


@dataclass(frozen=True)
class Scope:
    """The part of a run that an intervention changes."""

    bodies: Sequence[Body]
    joint: str | None = None
    """The joint of the only body; None for all of its joints."""
    site: str | None = None
    """File and line of the call that a finding is about."""
    other: Body | None = None
    """The other body of a finding about two."""
    target: str | None = None
    """Target of a cure: a body, a joint, an actuator."""
    commanded: frozenset[tuple[int, int]] = frozenset()
    """Numbers of bodies and links of the joints whose motors a call commands."""
    timestep_s: float = 1 / 240
    """The last timestep of the run."""
    whole: bool = False
    """Whether this is the whole run, because nothing else is named."""

    def links(self, body: Body) -> list[int]:
        """Return the links of the selected moving joints."""
        return [
            joint.link
            for joint in body.joints
            if joint.widths[0] and self.joint in (None, joint.name)
        ]


@dataclass(frozen=True)
class ChangedRun:
    """Differences of a run from the recorded one."""

    operations: list[dict[str, Any]] = field(default_factory=list)
    """The operations, as the engine's hooks take them."""
    below: dict[str, Any] = field(default_factory=dict)
    """What differs in the engine, unseen by the script: the arguments of a `Variation`, and
    `draws`, a seed that replaces the script's own."""
    edits: list[Any] = field(default_factory=list)
    """Parts of the script's text that are other ones, as `watching.edits` has them."""

    @property
    def finer(self) -> int:
        """The number of engine steps per step of the script."""
        return int(self.below.get("finer", 1))

    def __add__(self, other: ChangedRun) -> ChangedRun:
        """Return a run with the differences of both."""
        below = {**self.below, **other.below}
        if self.finer > 1 and other.finer > 1:
            below["finer"] = self.finer * other.finer
        operations = [*self.operations, *other.operations]
        return ChangedRun(operations, below, [*self.edits, *other.edits])


def whole_number(value: float) -> float:
    """Return a number in the form that an engine takes: a whole number as an integer."""
    return int(value) if float(value).is_integer() else value


NUDGE = 1e-9
"""Displacement of bodies and joints before the first step [m, rad]."""
NUDGED = ChangedRun(below={"nudge": NUDGE})
"""The run whose bodies and joints are moved by that much."""

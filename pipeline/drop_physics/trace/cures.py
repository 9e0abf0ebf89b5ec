"""Suggested changes as data, for any engine, and the run in which one is tried.

The table of interventions (`engines/…/interventions`) defines the code of each change, and the run
in which the change is made; `engines.cures` finds the table of an engine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drop_physics.trace.events import Body


@dataclass(frozen=True)
class Cure:
    """A suggested change, which a trial run can make: its kind, target and number."""

    name: str
    """Name of the intervention: `force`, `gains`, `timestep-first` …"""
    target: str | None = None
    """The body or joint that is changed; None for the whole run."""
    value: float | None = None
    """The new value; None if the intervention takes no number."""
    call: str = field(default="", compare=False)
    """The code that a user would write; the engine's table generates it if a rule leaves it
    empty."""
    form: str = field(default="", metadata={"json": False})
    """Variant of the intervention, if there are several."""
    given: Mapping[str, Any] = field(default_factory=dict, hash=False, metadata={"json": False})
    """Further numbers and names for the code and the trial, by argument."""
    bodies: tuple[str, ...] = field(default=(), metadata={"json": False})
    """Labels of the changed bodies, if they differ from those of the finding."""


@dataclass(frozen=True)
class Scope:
    """The bodies, joints or elements of a run that a change applies to."""

    bodies: Sequence[Body]
    joint: str | None = None
    """The joint of the only body; None for all of its joints."""
    site: str | None = None
    """File and line of the call that the finding is about."""
    other: Body | None = None
    """The second body, for a finding about two bodies."""
    target: str | None = None
    """Target of the intervention: a body, a joint, an actuator."""
    commanded: frozenset[tuple[int, int]] = frozenset()
    """Ids of bodies and links whose joint motors the call commands."""
    timestep_s: float = 1 / 240
    """The last timestep of the run."""
    whole: bool = False
    """Whether the change applies to the whole run, because nothing else is named."""

    def links(self, body: Body) -> list[int]:
        """Return the link indices of the joints that the change applies to."""
        return [
            joint.link
            for joint in body.joints
            if joint.widths[0] and self.joint in (None, joint.name)
        ]


@dataclass(frozen=True)
class ChangedRun:
    """How a changed run differs from the recorded one."""

    operations: list[dict[str, Any]] = field(default_factory=list)
    """The operations, as passed to the engine's hooks."""
    below: dict[str, Any] = field(default_factory=dict)
    """Changes within the engine that the script cannot notice: arguments of a `Variation`, and
    `draws`, a seed that replaces the script's own."""
    edits: list[Any] = field(default_factory=list)
    """Replaced parts of the user's texts, in the format of `watching.edits`."""
    longer: float = 1.0
    """Factor on the number of steps that the run may make."""

    @property
    def finer(self) -> int:
        """The number of engine steps per step of the script."""
        return int(self.below.get("finer", 1))

    def __add__(self, other: ChangedRun) -> ChangedRun:
        """Return a run with the changes of both runs."""
        below = {**self.below, **other.below}
        if self.finer > 1 and other.finer > 1:
            below["finer"] = self.finer * other.finer
        operations = [*self.operations, *other.operations]
        edits = [*self.edits, *other.edits]
        return ChangedRun(operations, below, edits, self.longer * other.longer)


def whole_number(value: float) -> float:
    """Return a number in the type that an engine expects: an int if it is whole."""
    return int(value) if float(value).is_integer() else value


NUDGE = 1e-9
"""Displacement of bodies and joints before the first step, to test sensitivity [m, rad]."""
NUDGED = ChangedRun(below={"nudge": NUDGE})
"""The changed run in which bodies and joints are displaced by `NUDGE`."""

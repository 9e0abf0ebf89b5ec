"""Data about differences between a recording and the golden one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.engine_report import EngineReport
from drop_physics.scenario import Scenario
from drop_physics.trace.history import Seen

Value = Any
"""A number, a text, a flag or a vector; None if a recording lacks the value."""


class DropInputs(NamedTuple):
    """The inputs of a drop: its scenario and its engine."""

    scenario: Scenario
    engine: EngineReport
    """Values that the engine reported."""


@dataclass(frozen=True)
class Side:
    """One of two recordings that are compared."""

    seen: Seen
    origin: Mapping[str, Any]
    """The script, the digest of its text, its arguments, the seed; empty for a drop."""
    ended: Mapping[str, Any]
    """How the run ended, and the versions of the software."""
    drop: DropInputs | None = None
    """The inputs of a drop; None for a script."""


@dataclass(frozen=True)
class Setting:
    """A setting that differs between two recordings, but is no difference in physics."""

    name: str
    """Name of the setting in the recording."""
    value: Value
    """The value in the checked recording."""
    golden: Value
    """The value in the golden recording."""


@dataclass(frozen=True)
class Difference:
    """A value that differs from the golden recording, or that the golden recording lacks."""

    step: int | None
    """Number of the simulation's steps before the difference; None for a setting of a whole drop.
    """
    body: str | None
    """Label of the body; None for a value that belongs to no body."""
    link: int | None
    """Link of the body, -1 is the base; None for a value that belongs to no link."""
    column: str
    """Name of the differing number: a column of the state, of joints, such as `joint_effort`, or of
    a contact point, such as `contact_distance_m`; `contact_points` is the number of contact points.
    `constraints.2.0` is the first force of constraint 2. `dynamics.mass_kg` and
    `engine.fixedTimeStep` are in the recording's entities of these names; elements of a vector are
    numbered from 0 at the end. `there` is whether a body or its sample exists (1 or 0), and `frame`
    is an image. For a drop's settings, the name in its scenario, with the prefix `engine.` where
    the engine's value differs and the scenario's does not."""
    value: Value = None
    """The value in the checked recording; None if that lacks it."""
    golden: Value = None
    """The value in the golden recording; None if that lacks it."""
    time_s: float | None = None
    """Simulated time of the step [s]; None for a value without a step."""
    part: str | None = None
    """Name of the link, or of its joint if the column belongs to a joint."""
    unit: str = ""
    """Unit of a joint's value; empty if the column's name states it."""

    @property
    def difference(self) -> float | None:
        """The value minus the golden value; None if either is not a number."""
        if all(type(each) in (int, float) for each in (self.value, self.golden)):
            return float(self.value - self.golden)
        return None


@dataclass(frozen=True)
class Largest:
    """The largest difference of one quantity of a body, over all common samples."""

    body: str
    """Label of the body."""
    link: int
    """Link where the difference is largest; -1 is the base."""
    quantity: str
    """`position`, `orientation`, `velocity` or `spin` of base and links; `joint_position`,
    `joint_velocity` or `joint_effort`."""
    difference: float
    """Magnitude of the difference."""
    step: int
    """Step at which the difference is largest."""
    unit: str = ""
    """`m`, `rad`, `m/s`, `rad/s`, `N` or `N m`."""
    part: str | None = None
    """Name of the link, or of its joint."""


class When(NamedTuple):
    """The moment of a difference; moments can be compared."""

    step: int
    phase: int
    """Order within a step: `LED`, a sample after a step, comes before `INPUT`, the inputs given
    then, and before `FIRST`, a body's first sample, which follows from these inputs."""
    call: int = 0
    """Number of calls that the script had made before."""


LED, INPUT, FIRST = range(3)


class Dated(NamedTuple):
    """A difference, with its simulation and its moment."""

    when: When
    client: int
    """Id of the simulation in the checked recording."""
    difference: Difference


def earliest(*differences: Dated | None) -> Dated | None:
    """Return the earliest difference; of simultaneous ones, the one listed first."""
    return min(filter(None, differences), key=lambda dated: dated.when, default=None)


def differs(value: Value, other: Value) -> bool:
    """Return whether two values differ; nan equals nan."""
    return bool(value != other and (value == value or other == other))


def off(mine: Float64, golden: Float64, allowed: Float64 | float = 0.0) -> Flags:
    """Flag the numbers that differ by more than allowed; nan and nan count as equal."""
    with np.errstate(invalid="ignore"):  # of infinite numbers
        near = np.abs(mine - golden) <= allowed
    differ: Flags = ~((mine == golden) | near | (np.isnan(mine) & np.isnan(golden)))
    return differ

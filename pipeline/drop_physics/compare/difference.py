"""Differences between a recording and the golden one."""

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
"""A number, a text, a flag or a vector; None if there is none."""


class DropInputs(NamedTuple):
    """A drop: its scenario and its engine."""

    scenario: Scenario
    engine: EngineReport
    """Values that the engine reported."""


@dataclass(frozen=True)
class Side:
    """One of two recordings."""

    seen: Seen
    origin: Mapping[str, Any]
    """The script, the digest of its text, its arguments, the seed; empty for a drop."""
    ended: Mapping[str, Any]
    """The end of the run, and the versions that made it."""
    drop: DropInputs | None = None
    """The inputs of a drop; None for a script."""


@dataclass(frozen=True)
class Setting:
    """A fact that differs between two recordings, without being a difference in physics."""

    name: str
    """Name in the recording."""
    value: Value
    """The value in the checked recording."""
    golden: Value
    """The value in the golden recording."""


@dataclass(frozen=True)
class Difference:
    """A value that the golden recording lacks, or that is different there."""

    step: int | None
    """Number of steps of its simulation before it; None for a setting of a whole drop."""
    body: str | None
    """Label of the body; None if it belongs to no body."""
    link: int | None
    """Link of the body, -1 is its base; None if it belongs to no link."""
    column: str
    """A column of the state, or of joints, as `joint_effort`, or of a contact point, as
    `contact_distance_m`; `contact_points` is how many there are. `constraints.2.0` is the first
    force of constraint 2. `dynamics.mass_kg` and `engine.fixedTimeStep` are in these entities of
    the recording; an element of a vector has its number after it, from 0. `there` is whether a body
    or its sample exists (1 or 0), and `frame` is an image. Of a drop's settings: the name in its
    scenario; `engine.` comes first where the engine's value differs and the scenario's does not."""
    value: Value = None
    """The value in the checked recording; None if there is none."""
    golden: Value = None
    """The value in the golden recording."""
    time_s: float | None = None
    """Simulated time of the step; None if it has none."""
    part: str | None = None
    """Name of the link, or of its joint if the column is one of joints."""
    unit: str = ""
    """Unit of a joint's value; empty if the column says it."""

    @property
    def difference(self) -> float | None:
        """Value minus golden; None if they are not numbers."""
        if all(type(each) in (int, float) for each in (self.value, self.golden)):
            return float(self.value - self.golden)
        return None


@dataclass(frozen=True)
class Largest:
    """The largest difference of a body in one quantity, over all common samples."""

    body: str
    """Label of the body."""
    link: int
    """Link where the difference is largest; -1 is the base."""
    quantity: str
    """`position`, `orientation`, `velocity`, `spin` of base and links; `joint_position`,
    `joint_velocity`, `joint_effort`."""
    difference: float
    """Magnitude of the difference."""
    step: int
    """Step at which the difference is largest."""
    unit: str = ""
    """`m`, `rad`, `m/s`, `rad/s`, `N` or `N m`."""
    part: str | None = None
    """Name of the link, or of its joint."""


class When(NamedTuple):
    """The moment of a difference; moments have an order."""

    step: int
    phase: int
    """`LED` (a sample that a step led to) comes before `INPUT` (the inputs given then) and `FIRST`
    (a first sample, after the inputs that led to it)."""
    call: int = 0
    """Number of calls of the script before it."""


LED, INPUT, FIRST = range(3)


class Dated(NamedTuple):
    """A difference with its simulation."""

    when: When
    client: int
    """Number of the client in the checked recording."""
    difference: Difference


def earliest(*differences: Dated | None) -> Dated | None:
    """Return the first of some differences; if several are simultaneous, the one listed first."""
    return min(filter(None, differences), key=lambda dated: dated.when, default=None)


def differs(value: Value, other: Value) -> bool:
    """Return whether two values differ; nan equals nan."""
    return bool(value != other and (value == value or other == other))


def off(mine: Float64, golden: Float64, allowed: Float64 | float = 0.0) -> Flags:
    """Flag the numbers that differ by more than allowed; nan equals nan."""
    with np.errstate(invalid="ignore"):  # of infinite numbers
        near = np.abs(mine - golden) <= allowed
    differ: Flags = ~((mine == golden) | near | (np.isnan(mine) & np.isnan(golden)))
    return differ

"""What an engine other than PyBullet has to do to drop a body: one small file each.

PyBullet reads the URDF, for every engine: so all of them drop the same mass, inertia and shapes,
and what differs is what they make of them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

from pipeline.kinds import Quaternion, Vector

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class Shape:
    """One part of a body's collision."""

    kind: str
    """box, sphere, cylinder or capsule; its axis is z."""
    size_m: Vector
    """A box's three edges; else radius, length of the cylindrical part and 0."""
    position_m: Vector
    """Of its centre, from the centre of mass, in the body's axes."""
    orientation: Quaternion
    """In the body's axes: x, y, z, w."""


@dataclass(frozen=True)
class RigidBody:
    """A body of one link; its axes are the principal ones, from the centre of mass."""

    name: str
    mass_kg: float
    inertia_kg_m2: Vector
    shapes: tuple[Shape, ...]


class Session(Protocol):
    """One body above one floor in an engine, built from a scenario and a `RigidBody`."""

    def step(self) -> None:
        """Take one timestep."""

    def state(self) -> Numbers:
        """Return 13 numbers, world axes: position, orientation x y z w, velocity and spin.

        Of the centre of mass, as the engine has them: rounded by nothing of ours but the turn of a
        spin that the engine keeps in the body's axes.
        """

    def contacts(self) -> Iterable[Numbers]:
        """Yield the points that acted in the last step, with the numbers of `states.CONTACT`.

        From `position_a_m` on, and as if the body were a: forces on it.
        """

    def reported(self) -> dict[str, Any]:
        """Return what the engine says of itself and of the body: fields of `EngineReport`."""

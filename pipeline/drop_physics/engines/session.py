"""The interface of an engine other than PyBullet that drops a body: one small file each.

PyBullet reads the URDF for every engine, so all of them drop the same mass, inertia and shapes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.option_types import Quaternion, Vector
from drop_physics.physics.rotations import matrix

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class PrimitiveShape:
    """A collision shape of a body."""

    kind: str
    """box, sphere, cylinder or capsule; its axis is z."""
    size_m: Vector
    """A box's three edges; a cylinder's or capsule's radius, length (of the capsule's cylindrical
    part) and 0; a sphere's radius first."""
    position_m: Vector
    """Position of the shape's centre from the centre of mass, in the body's axes."""
    orientation: Quaternion
    """Orientation in the body's axes: quaternion x, y, z, w."""

    def depth_m(self, body: Quaternion) -> float:
        """Return how far the shape reaches below the centre of mass, with the body turned."""
        up_in_body = matrix(body)[2]
        x, y, z = np.abs(up_in_body @ matrix(self.orientation))
        a, b, c = self.size_m
        half_m = {
            "box": (x * a + y * b + z * c) / 2,
            "sphere": a,
            "cylinder": z * b / 2 + np.hypot(x, y) * a,
            "capsule": z * b / 2 + a,
        }[self.kind]
        return float(half_m - up_in_body @ np.array(self.position_m))


@dataclass(frozen=True)
class RigidBody:
    """A body of one link; its axes are the principal ones, from the centre of mass."""

    name: str
    mass_kg: float
    inertia_kg_m2: Vector
    shapes: tuple[PrimitiveShape, ...]


def force_of_point(
    position_m: Float64, normal: Float64, distance_m: float, force_n: Float64
) -> Numbers:
    """Return the numbers of a contact point from the whole force on the body, shape (3,).

    What is not along the normal is friction.
    """
    push_n = float(normal @ force_n)
    friction = force_n - push_n * normal
    size_n = float(np.linalg.norm(friction))
    along = friction / size_n if size_n else np.zeros(3)
    point, up, nothing = position_m.tolist(), normal.tolist(), (0.0, 0.0, 0.0)
    return (*point, *point, *up, distance_m, push_n, size_n, *along.tolist(), 0.0, *nothing)


class Session(Protocol):
    """One body above one floor in an engine, built from a scenario and a `RigidBody`."""

    def step(self) -> None:
        """Take one timestep; raise RuntimeError if the engine cannot."""

    def state(self) -> Numbers:
        """Return the numbers of its state, which `motions` takes; the third is the height."""

    def motions(self, states: Float64) -> Float64:
        """Return states as 13 numbers each, world axes, shape (n, 13); as they are, if they are so.

        Position, orientation x y z w, velocity and spin of the centre of mass, exactly as in the
        engine; but a spin that the engine keeps in body axes is rotated, which rounds it.
        """
        return states

    def contacts(self) -> Iterable[Numbers]:
        """Yield the contact points of the last step.

        Each is the numbers of `states.CONTACT` from `position_a_m` on, with the body as a: the
        forces act on it.
        """

    def reported(self) -> dict[str, Any]:
        """Return what the engine reports about itself and the body: fields of `EngineReport`."""

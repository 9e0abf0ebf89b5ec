"""A rigid body for engines other than PyBullet, with the mass, inertia and shapes of the URDF.

PyBullet reads the URDF, so both engines drop the same mass, inertia and shapes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drop_physics.option_types import Quaternion, Vector
from drop_physics.physics.rotations import matrix


@dataclass(frozen=True)
class PrimitiveShape:
    """A collision shape of a body."""

    kind: str
    """box, sphere, cylinder or capsule; the shape's axis is z."""
    size_m: Vector
    """A box's three edges; a cylinder's or capsule's radius, length (of the capsule's cylindrical
    part) and 0; a sphere's radius first."""
    position_m: Vector
    """Position of the shape's centre from the centre of mass, in the body's axes."""
    orientation: Quaternion
    """Orientation in the body's axes: quaternion x, y, z, w."""

    def depth_m(self, body: Quaternion) -> float:
        """Return how far the shape reaches below the centre of mass in an orientation [m]."""
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
    """A body of one link; its axes are the principal axes of inertia, from the centre of mass."""

    name: str
    mass_kg: float
    inertia_kg_m2: Vector
    shapes: tuple[PrimitiveShape, ...]

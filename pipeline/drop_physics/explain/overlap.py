"""A test for the overlap of two convex shapes, from their poses alone, without an engine.

They overlap by a distance d if a ball of that diameter fits into both. Its centre is searched for
by projecting a point onto both shapes in turn, each shrunk by d/2: this converges to a point of
both if there is one (Bregman 1965). So an overlap that is found is real; a narrow one may be
missed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.convex import OUTSIDE, outside
from drop_physics.physics.rotations import rotate, rotate_inverse
from drop_physics.trace.events import Collision

TURNS = 400
"""Number of projections onto each shape."""
NEARLY = 0.9
"""Share of the shrinkage by which a point must be inside: projections only converge to it."""
SETTLED = 1e-3
"""Share of the shrinkage below which a projection no longer moves a point."""
DEEP_INSIDE_M = 1e6
"""Depth to which a plane, as a half space, extends."""


@dataclass(frozen=True, eq=False)
class PlacedShape:
    """A shape of a link, placed at n samples."""

    shape: Collision
    position_m: Float64
    """Positions of the shape's centre, shape (n, 3)."""
    orientation: Float64
    """Quaternions x, y, z, w, shape (n, 4)."""

    def only(self, rows: Int64) -> PlacedShape:
        """Return the shape at the selected samples."""
        return PlacedShape(self.shape, self.position_m[rows], self.orientation[rows])

    @cached_property
    def radius_m(self) -> float:
        """Radius of a bounding sphere around the shape's centre."""
        size, kind = np.abs(self.shape.size_m), self.shape.kind
        if kind == "plane":
            return DEEP_INSIDE_M
        if kind == "sphere":
            return float(size[0])
        if kind == "box":
            return float(np.linalg.norm(size) / 2)
        if kind in ("capsule", "cylinder"):
            return float(size[0] / 2 + size[1])
        corners = np.reshape(self.shape.hull_m, (-1, 3))
        return float(np.linalg.norm(corners, axis=1).max(initial=0.0))

    def outside(self, points_m: Float64) -> tuple[Float64, Float64]:
        """Return signed distances of points from the shape [m], negative inside; and gradients.

        The results have the shapes (n,) and (n, 3).
        """
        local = rotate_inverse(self.orientation, points_m - self.position_m)
        distance_m, way = outside(self.shape, local)
        return distance_m, rotate(self.orientation, way)


def is_convex(shape: Collision) -> bool:
    """Return whether `overlaps` supports a shape."""
    return shape.kind in OUTSIDE and (shape.kind != "mesh" or len(shape.hull_m) >= 12)


def overlaps(one: PlacedShape, two: PlacedShape, by_m: float) -> Flags:
    """Flag the samples in which two shapes overlap by at least `by_m`, shape (n,)."""
    found = np.zeros(len(one.position_m), np.bool_)
    apart_m = np.linalg.norm(one.position_m - two.position_m, axis=1)
    near = np.flatnonzero(apart_m < one.radius_m + two.radius_m)
    if not len(near):
        return found
    shapes, half_m = [each.only(near) for each in (one, two)], by_m / 2
    smaller = min(shapes, key=lambda shape: shape.radius_m)
    points_m, going = smaller.position_m.copy(), np.arange(len(near))
    for _ in range(TURNS):
        if not len(going):
            break
        began_m, ended_m = points_m[going], points_m[going]
        steps_m, nearer_m2 = np.zeros((2, len(going)))
        for shape in shapes:
            distance_m, way = shape.only(going).outside(ended_m)
            step_m = np.maximum(distance_m + half_m, 0.0)
            ended_m = ended_m - step_m[:, None] * way
            steps_m = np.maximum(steps_m, step_m)
            nearer_m2 += step_m * (step_m - 2 * (1 - NEARLY) * half_m)
        # Each projection brings it nearer to any point of both, by so much of the square. If it
        # went less than this takes, there is no such point.
        points_m[going] = ended_m
        from_m = began_m - smaller.position_m[going]
        reach_m = smaller.radius_m + np.linalg.norm(from_m, axis=1)
        apart = nearer_m2 > 2 * reach_m * np.linalg.norm(ended_m - began_m, axis=1)
        going = going[~apart & (steps_m > SETTLED * half_m)]
    inside = [shape.outside(points_m)[0] <= -half_m * NEARLY for shape in shapes]
    found[near] = inside[0] & inside[1]
    return found

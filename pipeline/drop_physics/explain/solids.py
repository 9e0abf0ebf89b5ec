"""Lower bounds on the overlap of convex shapes, from points of one inside the other.

A point of A at depth d in B has to move by d to leave B, so A and B overlap by at least d. Only
some points are tested (corners, axes, centres), so the real overlap may be deeper.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.explain.convex import hull_faces, outside_m
from drop_physics.physics.columns import rotation
from drop_physics.trace.events import Collision

LEVELS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Positions of points along the edges or the axis of a shape, as shares of half its length."""
ORIGIN, UPRIGHT = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
"""Pose of a hull on its link: its vertices are in the link's axes."""
ROUND = 8
"""Number of points around an axis."""
MOST_CORNERS = 64
"""Maximum number of points of a hull."""
AT_ONCE = 1 << 16
"""Maximum number of point-to-face distances that are computed without pruning."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A shape with sample points, in the axes of its link."""

    collision: Collision
    points_m: Float64
    """Points of the shape, shape (m, 3); none for a half space."""
    radius_m: float
    """Radius of a bounding sphere around the centre; infinite for a half space."""

    def depth_m(self, points_m: Float64) -> Float64:
        """Return a lower bound on the depth of points in the shape; negative outside, shape (n,).

        `points_m` are in the shape's own axes, shape (n, 3).
        """
        if self.collision.kind == "ellipsoid":
            size = np.array(self.collision.size_m)
            inside = 1 - np.linalg.norm(points_m / (size / 2), axis=1)
            return np.asarray(inside * size.min() / 2)
        return -outside_m(self.collision, points_m)

    def deepest_m(self, points_m: Float64) -> Float64:
        """Return a lower bound on the depth of the deepest point; 0 if none is inside, shape (n,).

        `points_m` are m points in n poses, in the shape's own axes, shape (n, m, 3).
        """
        if self.collision.kind == "mesh":
            faces = hull_faces(self.collision.hull_m)
            if faces is not None:
                return _deepest_m(points_m, faces)
        depth_m = self.depth_m(points_m.reshape(-1, 3)).reshape(points_m.shape[:2])
        return np.asarray(np.maximum(depth_m.max(axis=1), 0.0))


def solid_of(collision: Collision) -> Solid | None:
    """Return a collision shape with sample points; None for an unsupported kind."""
    kind, size = collision.kind, np.array(collision.size_m)
    if kind == "plane":
        return Solid(collision, np.empty((0, 3)), np.inf)
    if kind in ("sphere", "ellipsoid"):
        half = np.full(3, size[0]) if kind == "sphere" else size / 2
        points = np.array([*_directions()]) * half
    elif kind in ("capsule", "cylinder"):
        ring = np.array([*_ring()]) * size[1]
        points = np.array(
            [(x, y, level * size[0] / 2) for level in LEVELS for x, y in [(0.0, 0.0), *ring]]
        )
        if kind == "capsule":
            tips = [(0.0, 0.0, sign * (size[0] / 2 + size[1])) for sign in (-1, 1)]
            points = np.concatenate((points, tips))
    elif kind == "box":
        points = np.array([*product(LEVELS, repeat=3)]) * (size / 2)
    elif kind == "mesh" and len(collision.hull_m) >= 12:
        if hull_faces(collision.hull_m) is None:
            return None
        collision = replace(collision, position_m=ORIGIN, orientation=UPRIGHT)  # a hull's axes
        corners = np.reshape(collision.hull_m, (-1, 3))
        every = max(1, len(corners) // MOST_CORNERS)
        points = np.concatenate((corners[::every], [corners.mean(axis=0)]))
    else:
        return None
    with np.errstate(over="ignore"):  # a shape may be too large for its square
        radius = float(np.linalg.norm(points, axis=1).max())
    return Solid(collision, points, radius)


def overlap_m(
    a: Solid, at_a: tuple[Float64, Float64], b: Solid, at_b: tuple[Float64, Float64]
) -> Float64:
    """Return a lower bound on the overlap of two shapes; 0 where no point is inside, shape (n,).

    `at_a`, `at_b`: poses of their links, positions (n, 3) and rotations (n, 3, 3).
    """
    poses = [_placed(solid, *at) for solid, at in ((a, at_a), (b, at_b))]
    (place_a, turn_a), (place_b, turn_b) = poses
    found = np.zeros(len(place_a))
    near = np.linalg.norm(place_a - place_b, axis=1) < a.radius_m + b.radius_m
    for one, its, other, there in (
        (a, (place_a, turn_a), b, (place_b, turn_b)),
        (b, (place_b, turn_b), a, (place_a, turn_a)),
    ):
        if near.any() and len(one.points_m):
            world_m = one.points_m @ its[1][near].swapaxes(1, 2) + its[0][near][:, None]
            local_m = (world_m - there[0][near][:, None]) @ there[1][near]
            found[near] = np.maximum(found[near], other.deepest_m(local_m))
    return found


def _deepest_m(points_m: Float64, faces: Float64) -> Float64:
    """Return the depth of the deepest point in a convex hull; 0 if none is inside, shape (n,).

    `points_m` are m points in n poses, shape (n, m, 3), `faces` normals and offsets, shape (f, 4).
    """
    rows, count = points_m.shape[:2]
    if rows == 1 or rows * count * len(faces) <= AT_ONCE:
        outside_m = points_m.reshape(-1, 3) @ faces[:, :3].T + faces[:, 3]
        depth_m = -outside_m.max(axis=1).reshape(rows, count)
        return np.asarray(depth_m.max(axis=1, initial=0.0))
    # A point's distance from a face changes by no more than the point moves. So one look at the
    # middle of its way tells which points are never the deepest, and which faces never the next.
    middle_m = (points_m.min(axis=0) + points_m.max(axis=0)) / 2
    way_m = np.linalg.norm(points_m - middle_m, axis=2).max(axis=0)
    distance_m = middle_m @ faces[:, :3].T + faces[:, 3]
    outside_m = distance_m.max(axis=1)
    deep = outside_m - way_m <= min(0.0, float((outside_m + way_m).min()))
    if not deep.any():
        return np.zeros(rows)
    next_to = (distance_m[deep] >= (outside_m - 2 * way_m)[deep, None]).any(axis=0)
    left_m, half = points_m[:, deep], rows // 2
    return np.concatenate(
        [_deepest_m(each, faces[next_to]) for each in (left_m[:half], left_m[half:])]
    )


def _placed(solid: Solid, position_m: Float64, turn: Float64) -> tuple[Float64, Float64]:
    """Return position and rotation of a shape, from those of its link."""
    collision = solid.collision
    local = rotation(np.array(collision.orientation, np.float64)[:, None])[:, :, 0]
    return position_m + turn @ np.array(collision.position_m), turn @ local


def _directions() -> Iterator[tuple[float, float, float]]:
    """Yield unit vectors to a cube's faces and corners, and the zero vector."""
    yield 0.0, 0.0, 0.0
    for axis in range(3):
        for sign in (-1.0, 1.0):
            yield sign * (axis == 0), sign * (axis == 1), sign * (axis == 2)
    for x, y, z in product((-1.0, 1.0), repeat=3):
        yield x / np.sqrt(3), y / np.sqrt(3), z / np.sqrt(3)


def _ring() -> Iterator[tuple[float, float]]:
    """Yield unit vectors perpendicular to an axis."""
    for angle in np.arange(ROUND) * (2 * np.pi / ROUND):
        yield float(np.cos(angle)), float(np.sin(angle))

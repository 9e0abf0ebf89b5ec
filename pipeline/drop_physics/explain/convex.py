"""Signed distances of points from convex shapes, negative inside."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.trace.events import Collision


def outside_m(shape: Collision, local: Float64) -> Float64:
    """Return the signed distance of points from a shape [m], negative inside, shape (n,).

    `local` are the points in the shape's own axes, shape (n, 3).
    """
    return OUTSIDE[shape.kind](shape, local)


def _sphere(shape: Collision, local: Float64) -> Float64:
    return np.asarray(np.linalg.norm(local, axis=1) - shape.size_m[0])


def _plane(shape: Collision, local: Float64) -> Float64:
    # PyBullet reports the plane's normal as its size; MuJoCo's is the z axis.
    normal = shape.size_m if len(shape.size_m) == 3 else (0.0, 0.0, 1.0)
    return np.asarray(local @ np.array(normal))


def _box(shape: Collision, local: Float64) -> Float64:
    return np.asarray((np.abs(local) - np.array(shape.size_m) / 2).max(axis=1))


def _cylinder(shape: Collision, local: Float64) -> Float64:
    length_m, radius_m = shape.size_m[:2]
    side_m, end_m = np.hypot(local[:, 0], local[:, 1]) - radius_m, np.abs(local[:, 2])
    return np.asarray(np.maximum(side_m, end_m - length_m / 2))


def _capsule(shape: Collision, local: Float64) -> Float64:
    length_m, radius_m = shape.size_m[:2]
    nearest = local * [0.0, 0.0, 1.0]
    nearest[:, 2] = nearest[:, 2].clip(-length_m / 2, length_m / 2)
    return np.asarray(np.linalg.norm(local - nearest, axis=1) - radius_m)


def _mesh(shape: Collision, local: Float64) -> Float64:
    faces = hull_faces(shape.hull_m)
    if faces is None:
        return np.full(len(local), np.inf)
    return np.asarray((local @ faces[:, :3].T + faces[:, 3]).max(axis=1))


@lru_cache(maxsize=64)
def hull_faces(corners_m: tuple[float, ...]) -> Float64 | None:
    """Return the faces of a convex hull: outward normals and offsets, shape (f, 4).

    `corners_m` has three coordinates per corner [m]. None if all corners lie in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError  # takes a tenth of a second to import

    try:
        return np.asarray(ConvexHull(np.reshape(corners_m, (-1, 3))).equations)
    except QhullError:
        return None


OUTSIDE: dict[str, Callable[[Collision, Float64], Float64]] = {
    "sphere": _sphere,
    "plane": _plane,
    "box": _box,
    "cylinder": _cylinder,
    "capsule": _capsule,
    "mesh": _mesh,
}
"""Functions that return the signed distances of points from a shape, in the shape's axes, by kind
of shape."""


def is_convex(shape: Collision) -> bool:
    """Return whether `outside_m` supports a shape."""
    return shape.kind in OUTSIDE and (shape.kind != "mesh" or len(shape.hull_m) >= 12)

"""Signed distances of points from convex shapes, negative inside, with outward normals."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.trace.events import Collision


def outside(shape: Collision, local: Float64) -> tuple[Float64, Float64]:
    """Return the signed distance of points from a shape [m], negative inside, and its gradient.

    `local` has the points in the shape's own axes, shape (n, 3). The results have the shapes (n,)
    and (n, 3).
    """
    return OUTSIDE[shape.kind](shape, local)


def _unit(vectors: Float64) -> tuple[Float64, Float64]:
    lengths = np.linalg.norm(vectors, axis=1)
    return lengths, vectors / np.maximum(lengths, 1e-300)[:, None]


def _sphere(shape: Collision, local: Float64) -> tuple[Float64, Float64]:
    lengths, way = _unit(local)
    return lengths - shape.size_m[0], way


def _faces(normals: Float64, offsets: Float64, local: Float64) -> tuple[Float64, Float64]:
    distances_m = local @ normals.T - offsets
    most = distances_m.argmax(axis=1)
    return distances_m[np.arange(len(local)), most], normals[most]


def _plane(shape: Collision, local: Float64) -> tuple[Float64, Float64]:
    # PyBullet reports the plane's normal as its size; MuJoCo's is the z axis.
    normal = shape.size_m if len(shape.size_m) == 3 else (0.0, 0.0, 1.0)
    return _faces(np.array([normal]), np.zeros(1), local)


def _box(shape: Collision, local: Float64) -> tuple[Float64, Float64]:
    half_m = np.array(shape.size_m) / 2
    return _faces(np.vstack((np.eye(3), -np.eye(3))), np.hstack((half_m, half_m)), local)


def _cylinder(shape: Collision, local: Float64) -> tuple[Float64, Float64]:
    length_m, radius_m = shape.size_m[:2]
    lengths = np.hypot(local[:, 0], local[:, 1])
    way = local * [1.0, 1.0, 0.0] / np.maximum(lengths, 1e-300)[:, None]
    side, end = lengths - radius_m, np.abs(local[:, 2]) - length_m / 2
    up = np.sign(local[:, 2:]) * [0.0, 0.0, 1.0]
    return np.maximum(side, end), np.where((side > end)[:, None], way, up)


def _capsule(shape: Collision, local: Float64) -> tuple[Float64, Float64]:
    length_m, radius_m = shape.size_m[:2]
    nearest = local * [0.0, 0.0, 1.0]
    nearest[:, 2] = nearest[:, 2].clip(-length_m / 2, length_m / 2)
    lengths, way = _unit(local - nearest)
    return lengths - radius_m, way


def _mesh(shape: Collision, local: Float64) -> tuple[Float64, Float64]:
    faces = hull_faces(shape.hull_m)
    if faces is None:
        return np.full(len(local), np.inf), np.zeros_like(local)
    return _faces(faces[:, :3], -faces[:, 3], local)


@lru_cache(maxsize=64)
def hull_faces(corners_m: tuple[float, ...]) -> Float64 | None:
    """Return the faces of a convex hull: outward normals and offsets, shape (f, 4).

    `corners_m` has three numbers for each corner. None if they lie in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError  # takes a tenth of a second to import

    try:
        return np.asarray(ConvexHull(np.reshape(corners_m, (-1, 3))).equations)
    except QhullError:
        return None


OUTSIDE: dict[str, Callable[[Collision, Float64], tuple[Float64, Float64]]] = {
    "sphere": _sphere,
    "plane": _plane,
    "box": _box,
    "cylinder": _cylinder,
    "capsule": _capsule,
    "mesh": _mesh,
}
"""Functions that return the signed distances of points, in a shape's axes, from a shape of each
kind."""

"""Rotate vectors between the world's axes and a body's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.laws.vectors import cross, sums

Float64 = NDArray[np.float64]


def rotate(orientation: Float64, vectors: Float64) -> Float64:
    """Rotate vectors, shape (n, 3), by unit quaternions x, y, z, w, shape (n, 4).

    Source: v + 2 u × (u × v + w v), the vector form of q v q*.
    """
    axis, w = orientation[:, :3], orientation[:, 3:]
    return vectors + 2 * cross(axis, cross(axis, vectors) + w * vectors)


def rotate_inverse(orientation: Float64, vectors: Float64) -> Float64:
    """Rotate vectors back by unit quaternions x, y, z, w; shapes (n, 4) and (n, 3)."""
    return rotate(orientation * [-1, -1, -1, 1], vectors)


def same_way(orientation: Float64, reference: Float64) -> Float64:
    """Return quaternions, (n, 4), with the signs of others: q and -q are the same orientation."""
    agree = sums(orientation * reference)[:, None]
    return np.where(agree < 0, -orientation, orientation)


def matrix(orientation: Sequence[float]) -> Float64:
    """Return the rotation matrix of a unit quaternion x, y, z, w, shape (3, 3)."""
    return rotate(np.tile(orientation, (3, 1)), np.eye(3)).T

"""Rotates vectors between world axes and body axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.physics.vectors import cross, sums


def rotate(orientation: Float64, vectors: Float64) -> Float64:
    """Rotate vectors, shape (n, 3), by unit quaternions x, y, z, w, shape (n, 4).

    Source: v + 2 u × (u × v + w v), the vector form of q v q*.
    """
    axis, w = orientation[:, :3], orientation[:, 3:]
    return vectors + 2 * cross(axis, cross(axis, vectors) + w * vectors)


def rotate_inverse(orientation: Float64, vectors: Float64) -> Float64:
    """Rotate vectors by the inverse of unit quaternions x, y, z, w; shapes (n, 4) and (n, 3)."""
    return rotate(orientation * [-1, -1, -1, 1], vectors)


def products(a: Float64, b: Float64) -> Float64:
    """Return products of quaternions x, y, z, w, shape (n, 4), which apply b's rotation first."""
    axis_a, w_a, axis_b, w_b = a[:, :3], a[:, 3:], b[:, :3], b[:, 3:]
    axes = w_a * axis_b + w_b * axis_a + cross(axis_a, axis_b)
    return np.hstack((axes, w_a * w_b - sums(axis_a * axis_b)[:, None]))


def rotation_vectors(before: Float64, after: Float64) -> Float64:
    """Return the rotations between unit quaternions x, y, z, w as vectors [rad], shape (n, 3).

    The length is the angle, at most π, about the vector, in the axes of the quaternions.
    """
    between = products(after, before * [-1, -1, -1, 1])
    between = np.where(between[:, 3:] < 0, -between, between)
    sine = np.linalg.norm(between[:, :3], axis=1)
    angle = 2 * np.arctan2(sine, between[:, 3])
    return np.asarray(between[:, :3] * (angle / np.maximum(sine, 1e-300))[:, None])


def same_way(orientation: Float64, reference: Float64) -> Float64:
    """Return quaternions, (n, 4), with the signs nearest to others: q and -q are equal."""
    agree = sums(orientation * reference)[:, None]
    return np.where(agree < 0, -orientation, orientation)


def quaternions(matrices: Float64) -> Float64:
    """Convert rotation matrices, shape (3, 3, n), to unit quaternions x, y, z, w, shape (n, 4).

    Source: the largest component is found first, which keeps the others accurate (Shepperd 1978,
    Journal of Guidance and Control 1, p. 223).
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrices
    # Four times the products of each component with x, y, z, w.
    products = np.array(
        [
            [1 + xx - yy - zz, xy + yx, xz + zx, zy - yz],
            [xy + yx, 1 - xx + yy - zz, yz + zy, xz - zx],
            [xz + zx, yz + zy, 1 - xx - yy + zz, yx - xy],
            [zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz],
        ]
    )
    largest = np.argmax(np.array([products[k, k] for k in range(4)]), axis=0)
    chosen = products[largest, :, np.arange(len(xx))]
    return np.asarray(chosen / np.linalg.norm(chosen, axis=1, keepdims=True))


def matrix(orientation: Sequence[float]) -> Float64:
    """Convert a unit quaternion x, y, z, w to a rotation matrix, shape (3, 3)."""
    return rotate(np.tile(orientation, (3, 1)), np.eye(3)).T

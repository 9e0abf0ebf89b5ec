"""Arithmetic on vectors and matrices for many steps; steps last: shapes (3, n) and (3, 3, n).

The values of each component are contiguous in memory, which numpy processes several times as fast
as rows of three.
"""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Float64


def cross(a: Float64, b: Float64) -> Float64:
    """Return the cross products, shape (3, n)."""
    out = np.empty((3, *np.broadcast_shapes(a.shape[1:], b.shape[1:])))
    np.subtract(a[1] * b[2], a[2] * b[1], out=out[0])
    np.subtract(a[2] * b[0], a[0] * b[2], out=out[1])
    np.subtract(a[0] * b[1], a[1] * b[0], out=out[2])
    return out


def dot(a: Float64, b: Float64) -> Float64:
    """Return the scalar products, shape (n,)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def length(a: Float64) -> Float64:
    """Return the lengths, shape (n,)."""
    return np.asarray(np.sqrt(dot(a, a)))


def times(matrix: Float64, vector: Float64) -> Float64:
    """Return the matrix-vector products, shape (3, n)."""
    out = matrix[:, 0] * vector[0] + matrix[:, 1] * vector[1] + matrix[:, 2] * vector[2]
    return np.asarray(out)


def fixed_vector(matrix: Float64, vector: Float64) -> Float64:
    """Return the products of matrices, (3, 3, n), with one vector, (3,): shape (3, n)."""
    return np.asarray(vector @ matrix)


def fixed_matrix(matrix: Float64, right: Float64) -> Float64:
    """Return the products of matrices, (3, 3, n), with one matrix, (3, 3): shape (3, 3, n)."""
    return np.asarray(right.T @ matrix)


def turning_back(matrix: Float64, vector: Float64) -> Float64:
    """Return the products of transposed matrices with vectors, shape (3, n)."""
    return np.asarray(matrix[0] * vector[0] + matrix[1] * vector[1] + matrix[2] * vector[2])


def rotation(quaternion: Float64) -> Float64:
    """Return the rotation matrices, (3, 3, n), of quaternions x, y, z, w, (4, n) or (4,)."""
    x, y, z, w = quaternion
    s = 2.0 / (x * x + y * y + z * z + w * w)
    xs, ys, zs = x * s, y * s, z * s
    return np.array(
        [
            [1.0 - (y * ys + z * zs), x * ys - w * zs, x * zs + w * ys],
            [x * ys + w * zs, 1.0 - (x * xs + z * zs), y * zs - w * xs],
            [x * zs - w * ys, y * zs + w * xs, 1.0 - (x * xs + y * ys)],
        ]
    )


def product(a: Float64, b: Float64) -> Float64:
    """Return the matrix products, both factors (3, 3, n)."""
    return np.stack([times(a, b[:, column]) for column in range(3)], axis=1)


def skew(vector: Float64) -> Float64:
    """Return the matrix whose product with a vector is the cross product, shape (3, 3)."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])

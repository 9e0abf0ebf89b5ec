"""Which numbers of two states differ by more than is allowed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

VECTORS = (slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13))
"""The columns of a state: position, quaternion, velocity, spin."""


def off(mine: Float64, golden: Float64, allowed: Float64 | float = 0.0) -> NDArray[np.bool_]:
    """Return which numbers differ by more than allowed; nan equals nan."""
    with np.errstate(invalid="ignore"):  # of infinite numbers
        near = np.abs(mine - golden) <= allowed
    differ: NDArray[np.bool_] = ~((mine == golden) | near | (np.isnan(mine) & np.isnan(golden)))
    return differ


def states_off(mine: Float64, golden: Float64, allowed: Float64) -> NDArray[np.bool_]:
    """Return which numbers of states differ by more than allowed, all of shape (rows, 13).

    A tolerance is that of a whole vector: where a difference is too long, though none of its
    components is, the largest of them is off.
    """
    differ = off(mine, golden, allowed)
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.abs(mine - golden)
        for columns in VECTORS:
            long = np.linalg.norm(size[:, columns], axis=1) > allowed[:, columns].max(axis=1)
            (rows,) = np.nonzero(long & ~differ[:, columns].any(axis=1))
            differ[rows, columns.start + np.argmax(size[rows, columns], axis=1)] = True
    return differ

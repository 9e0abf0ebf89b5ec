"""Arithmetic on many vectors, shape (n, 3), column by column.

numpy reduces a last axis of three numbers row by row, which takes five to fifteen times as long.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int64


def largest(vectors: Float64) -> Float64:
    """Return the maximum absolute component of each vector, shape (n,); nan if any is nan."""
    return functools.reduce(np.maximum, np.abs(vectors).T, np.zeros(len(vectors)))


def sums(vectors: Float64) -> Float64:
    """Return the sum of the components of each vector, in their order, shape (n,)."""
    return functools.reduce(np.add, vectors.T)


def lengths(vectors: Float64) -> Float64:
    """Return the length of each vector, shape (n,)."""
    return np.asarray(np.sqrt(sums(vectors * vectors)))


def triple(vector: Float64) -> tuple[float, float, float]:
    """Convert a vector to a tuple of three numbers."""
    x, y, z = vector.tolist()
    return x, y, z


def any_of(flags: Flags) -> Flags:
    """Flag the rows in which any flag is set, shape (n,)."""
    return functools.reduce(np.logical_or, flags.T)


def cross(a: Float64, b: Float64) -> Float64:
    """Return the cross products, shape (n, 3)."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=1)


def groups(numbers: Int64) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Yield each distinct number in ascending order, with the indices of its rows."""
    order = np.argsort(numbers, kind="stable")
    found, starts = np.unique(numbers[order], return_index=True)
    yield from zip(found.tolist(), np.split(order, starts[1:]), strict=True) if len(found) else ()


def distinct(numbers: Int64) -> tuple[Int64, Int64]:
    """Remove consecutive repetitions, and return the index of each number's run."""
    new = np.ones(len(numbers), np.bool_)
    new[1:] = numbers[1:] != numbers[:-1]
    return numbers[new], np.cumsum(new) - 1


def distinct_rows(numbers: Int64) -> tuple[Int64, Int64, Int64]:
    """Return the distinct rows of integers, sorted, and each row's index among them.

    `numbers` has the shape (n, k). Returns the distinct rows, shape (d, k); the index of the first
    equal row of `numbers`, shape (d,); and the index of the distinct row for every row, shape (n,).
    NumPy's `unique` compares rows as records, which takes ten times as long. Raises `ValueError` if
    the product of the columns' ranges exceeds 2⁶³.
    """
    least = numbers.min(axis=0, initial=0)
    ranges = tuple((numbers.max(axis=0, initial=0) - least + 1).tolist())
    keys = np.zeros(len(numbers), np.int64)  # without columns all are alike
    if ranges:
        keys = np.ravel_multi_index(tuple((numbers - least).T), ranges)
    _, first, which = np.unique(keys, return_index=True, return_inverse=True)
    return numbers[first], first, which


def distinct_bytes(rows: NDArray[Any]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the index of the first of each set of equal rows, and each row's set.

    `rows` has the shape (n, k). The d sets are sorted by bytes; the results have the shapes (d,)
    and (n,).
    """
    size = rows.shape[1] * rows.itemsize
    if not size:
        return np.arange(min(len(rows), 1)), np.zeros(len(rows), np.intp)
    whole = np.ascontiguousarray(rows).view(f"V{size}")[:, 0]
    _, first, which = np.unique(whole, return_index=True, return_inverse=True)
    return first, which


def summed(rows: Int64, vectors: Float64, *, count: int) -> Float64:
    """Return the sum of the vectors in each row, in their order, shape (count, k)."""
    columns = [np.bincount(rows, column, minlength=count) for column in vectors.T]
    # Without rows numpy counts in integers.
    return np.stack(columns, axis=1, dtype=np.float64)

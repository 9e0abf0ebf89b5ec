"""Distinct rows of integers are the same as from NumPy's `unique`, with the same indices."""

from __future__ import annotations

import numpy as np
import pytest
from drop_physics.physics.vectors import distinct_bytes, distinct_rows


@pytest.mark.parametrize(("count", "columns"), [(0, 4), (1, 2), (5, 0), (500, 3), (500, 4)])
def test_distinct_rows_are_those_of_numpy(count: int, columns: int) -> None:
    """Negative numbers occur, such as the base's link index -1; empty arrays are covered too."""
    numbers = np.random.default_rng(count).integers(-1, 5, size=(count, columns))
    rows, first, which = distinct_rows(numbers)
    expected = np.unique(numbers, axis=0, return_index=True, return_inverse=True)
    assert rows.tolist() == expected[0].tolist()
    assert first.tolist() == expected[1].tolist()
    assert which.tolist() == expected[2].ravel().tolist()


def test_rows_that_no_whole_number_holds_are_refused() -> None:
    """Otherwise they would be confused with other rows."""
    with pytest.raises(ValueError, match="dims"):
        distinct_rows(np.array([[0, 0], [2**40, 2**40]]))


@pytest.mark.parametrize("columns", [0, 1, 9])
def test_flags_are_told_apart_by_their_bytes(columns: int) -> None:
    flags = np.random.default_rng(columns).integers(0, 2, (200, columns)).astype(np.bool_)
    first, which = distinct_bytes(flags)
    expected = np.unique(flags, axis=0, return_index=True, return_inverse=True)
    assert flags[first].tolist() == expected[0].tolist()
    assert first.tolist() == expected[1].tolist()
    assert which.tolist() == expected[2].ravel().tolist()

"""Consecutive steps of pairs of bodies that touch, put together over pieces."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.contact_points import Pairs

Both = tuple[int, int]
"""Numbers of two bodies."""


class Run(Protocol):
    """What is known of some consecutive steps of a pair."""

    @property
    def first(self) -> int:
        """The first of them."""

    @property
    def last(self) -> int:
        """The last of them."""

    def then(self, more: Self) -> Self:
        """Return both as one; `more` follows."""


R = TypeVar("R", bound=Run)


class Runs(Generic[R]):
    """Of each pair the run that is most: `size` tells how much it is, 0 if it is none."""

    def __init__(self, size: Callable[[Both, R], float]) -> None:
        self._size = size
        self._open: dict[Both, R] = {}
        self._found: dict[Both, tuple[float, R]] = {}

    def add(self, both: Both, run: R) -> None:
        """Take a run, which may go on where the last one of the pair ended."""
        last = self._open.get(both)
        if last is not None and last.last + 1 == run.first:
            run = last.then(run)
        else:
            self._close(both)
        self._open[both] = run

    def _close(self, both: Both) -> None:
        run = self._open.pop(both, None)
        size = 0.0 if run is None else self._size(both, run)
        if run is not None and size > self._found.get(both, (0.0,))[0]:
            self._found[both] = size, run

    def most(self) -> Iterator[tuple[int, int, R]]:
        """Yield both bodies and their run, after the last piece."""
        for both in [*self._open]:
            self._close(both)
        for (first, second), (_, run) in self._found.items():
            yield first, second, run


def consecutive(pairs: Pairs, which: NDArray[np.bool_]) -> Iterator[tuple[Both, NDArray[np.intp]]]:
    """Yield the rows of each pair of two bodies in consecutive steps, of those that are marked."""
    for first, second, rows in pairs.by_pair(which):
        for part in np.split(rows, np.flatnonzero(np.diff(pairs.step[rows]) != 1) + 1):
            if first != second:
                yield (first, second), part

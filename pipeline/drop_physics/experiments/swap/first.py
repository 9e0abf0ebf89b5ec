"""Finds the first difference between two runs, and the first differing input."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.experiments.swap.answer import First
from drop_physics.trace.swaps import Common, Paired

ORDER = ("motion", "hidden", "input", "edit")


@dataclass(frozen=True, eq=False)
class FirstInput:
    """Inputs of both runs before a step, some of which differ."""

    paired: Paired
    step: int
    columns: list[int]

    @property
    def values(self) -> tuple[float, float]:
        """The first differing number, one value per run."""
        row, column = self.step, self.columns[0]
        return float(self.paired.before_a[row, column]), float(self.paired.before_b[row, column])

    @property
    def size(self) -> float:
        """The largest difference."""
        a, b = (each[self.step, self.columns] for each in _both(self.paired))
        return float(np.abs(a - b).max())

    @property
    def share(self) -> float:
        """The largest difference, relative to the number."""
        a, b = (each[self.step, self.columns] for each in _both(self.paired))
        off = np.abs(a - b)
        return float(off.max() / max(float(np.abs(a[off.argmax()])), 1e-300))

    @property
    def elements(self) -> list[str]:
        """The elements that the differing numbers belong to."""
        return [*dict.fromkeys(self.paired.elements[column] for column in self.columns)]


def _both(paired: Paired) -> tuple[Float64, Float64]:
    return paired.before_a, paired.before_b


def differs(a: Float64, b: Float64, tolerance: float = 0.0) -> Flags:
    """Flag the numbers that differ: bitwise, or by more than a tolerance."""
    if tolerance:
        return np.asarray(~(np.abs(a - b) <= tolerance) & ~(np.isnan(a) & np.isnan(b)))
    both = [np.ascontiguousarray(each, np.float64).view(np.uint64) for each in (a, b)]
    return np.asarray(both[0] != both[1])


def first_apart(common: Common, tolerance: float) -> First | None:
    """Return the first difference in positions or velocities after a step; None without one."""
    found: list[tuple[int, Paired, Flags]] = []
    for each in common.columns:
        if each.kind == "motion" and each.after_a is not None and each.after_b is not None:
            apart = differs(each.after_a, each.after_b, tolerance)
            rows = np.flatnonzero(apart.any(axis=1))
            if len(rows):
                found.append((int(rows[0]), each, apart))
    if not found:
        return None
    step = min(row for row, _, _ in found)
    bodies: dict[str, None] = {}
    size, unit = -1.0, ""
    for row, each, apart in found:
        if row != step or each.after_a is None or each.after_b is None:
            continue
        columns = np.flatnonzero(apart[step])
        bodies |= dict.fromkeys(each.elements[column] for column in columns.tolist())
        off = np.abs(each.after_a[step] - each.after_b[step])[columns]
        most = int(np.argmax(off))
        if off[most] > size:
            size, unit = float(off[most]), each.units[columns[most]]
    return First(step, float(common.times_s[0][step]), [*bodies], size, unit)


def first_given(columns: Iterable[Paired], until: int) -> FirstInput | None:
    """Return the first differing input up to a step: states, then inputs, then writes."""
    found = [each for paired in columns if (each := _given(paired, until)) is not None]
    return min(found, key=lambda each: (each.step, ORDER.index(each.paired.kind)), default=None)


def _given(paired: Paired, until: int) -> FirstInput | None:
    apart = differs(paired.before_a[: until + 1], paired.before_b[: until + 1])
    if paired.after_a is not None and paired.after_b is not None:
        left = differs(paired.after_a[:until], paired.after_b[:until])
        apart[1:] &= ~left  # what a step has led to was not given
    rows = np.flatnonzero(apart.any(axis=1))
    if not len(rows):
        return None
    step = int(rows[0])
    return FirstInput(paired, step, np.flatnonzero(apart[step]).tolist())


def first_hidden(common: Common, until: int) -> int | None:
    """Return the first step after which whole states differ, hidden arrays included, or None."""
    steps = [
        int(rows[0])
        for column in common.columns
        if column.after_a is not None and column.after_b is not None
        if len(rows := np.flatnonzero(differs(column.after_a, column.after_b).any(axis=1)))
    ]
    step = min(steps, default=until)
    return step if step < until else None


def given_at(columns: Iterable[Paired], step: int) -> Iterator[FirstInput]:
    """Yield the inputs that differ before a step, grouped by element."""
    for paired in columns:
        apart = np.flatnonzero(differs(paired.before_a[step], paired.before_b[step]))
        by_element: dict[str, list[int]] = {}
        for column in apart.tolist():
            by_element.setdefault(paired.elements[column], []).append(column)
        for its in by_element.values():
            yield FirstInput(paired, step, its)


def lateness(given: FirstInput) -> str:
    """Return which run, `a` or `b`, changes an input one step later; empty for neither."""
    row, column = given.step, given.columns[0]
    a, b = (each[:, column] for each in _both(given.paired))
    if not row or a[row - 1] != b[row - 1]:
        return ""
    if row + 1 < len(a):
        if b[row] == b[row - 1] and b[row + 1] == a[row]:
            return "b"
        if a[row] == a[row - 1] and a[row + 1] == b[row]:
            return "a"
    return ""

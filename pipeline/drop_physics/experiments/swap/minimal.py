"""Finds a minimal set of differences that still has an effect, by delta debugging.

A. Zeller and R. Hildebrandt, Simplifying and Isolating Failure-Inducing Input, IEEE Transactions on
Software Engineering 28 (2002): halves are removed first, then ever smaller parts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

T = TypeVar("T")

MOST_TRIALS = 300
"""Most trials; then the set found so far counts as minimal."""


def minimal(units: Sequence[T], holds: Callable[[list[T]], bool]) -> list[T]:
    """Return a minimal set for which `holds` is true, given that it is for all units together.

    Units are removed in their order, so that the last ones tend to remain.
    """
    left, parts, trials = list(units), 2, 0
    while len(left) > 1 and trials < MOST_TRIALS:
        size = max(1, len(left) // parts)
        for begin in range(0, len(left), size):
            rest = left[:begin] + left[begin + size :]
            trials += 1
            if rest and holds(rest):
                left, parts = rest, max(2, parts - 1)
                break
        else:
            if size == 1:
                break
            parts = min(len(left), 2 * parts)
    return left

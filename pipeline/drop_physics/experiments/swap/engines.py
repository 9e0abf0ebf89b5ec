"""Finds why runs of two engines differ, by removing known differences of their defaults.

Runs of two engines are never equal bit for bit, but without contact they agree to rounding if no
known difference applies. Known differences are removed one at a time, then all together, then as
few as possible; those whose removal makes both runs agree well beyond the first difference are the
cause. After a contact, the only claim is that bodies touch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.experiments.swap.answer import (
    DifferenceCause,
    End,
    First,
    ProvedDifference,
    SwapProof,
)
from drop_physics.experiments.swap.minimal import minimal
from drop_physics.trace.logs import KnownDifference
from drop_physics.trace.swaps import EndApart

BEYOND = 40
"""Number of steps after the first difference in which both runs must agree, too."""

Trails = Callable[[Sequence[int], int], tuple[Float64, Float64] | None]
"""Function that returns both runs' numbers after each step, in corresponding columns, shapes (n,
k), with some known differences removed; None where that is impossible."""


@dataclass(frozen=True, eq=False)
class WhyEngines:
    """Finds which known differences make runs of two engines differ.

    Parameters
    ----------
    known
        The known differences of the engines' defaults.
    trails
        Function that repeats both runs with some known differences removed.
    labels, units
        Name of the body or joint that each compared number belongs to, and its unit.
    lengths
        Number of steps of each run.
    times_s
        The first run's clock after each step [s].
    tolerance
        The largest difference that counts as none.
    touches
        Returns whether any bodies have touched by a given step, in either run.
    apart
        Returns the largest distance between the runs, at the last step that both make.
    """

    known: Sequence[KnownDifference]
    trails: Trails
    labels: Sequence[str]
    units: Sequence[str]
    lengths: tuple[int, int]
    times_s: Float64
    tolerance: float
    touches: Callable[[int], bool]
    apart: Callable[[], EndApart]

    def answer(self) -> ProvedDifference:
        """Find the differences that explain how the runs differ, and return the result."""
        count = min(self.lengths)
        first = self._first(self.trails((), count))
        if first is None:
            until_s = float(self.times_s[count - 1])
            return ProvedDifference(self.lengths, count - 1, until_s, None, "none")
        step, end = first.step, self.apart()
        answer = ProvedDifference(
            self.lengths,
            step - 1,
            float(self.times_s[step - 1]) if step else 0.0,
            first,
            "engines",
            end=End(end.value, end.unit, end.body),
        )
        steps = min(count, step + BEYOND)
        every = [*range(len(self.known))]
        alone = [each for each in every if self._holds([each], steps)]
        least = alone[:1]
        if not least and every and self._holds(every, steps):
            least = minimal(every, lambda some: self._holds(some, steps))
        if not least:
            if not self.touches(step):
                return answer
            return replace(
                answer, cls="step", because=[DifferenceCause("known", "contacts", step=step)]
            )
        settings = all(self.known[each].is_setting for each in least)
        then = self._first(self.trails(least, count))
        return replace(
            answer,
            cls="settings" if settings else "model",
            because=[
                DifferenceCause("known", its.name, None, its.value, its.other)
                for its in (self.known[each] for each in least)
            ],
            proved=SwapProof("known", count if then is None else then.step, count, exact=False),
        )

    def _holds(self, known: Sequence[int], steps: int) -> bool:
        trails = self.trails(known, steps)
        return trails is not None and self._first(trails) is None

    def _first(self, trails: tuple[Float64, Float64] | None) -> First | None:
        """Return the first difference between the two runs' numbers."""
        if trails is None:
            return First(0, 0.0, [], float("nan"), "")
        a, b = trails
        off = np.abs(a - b)
        beyond = ~(off <= self.tolerance)
        rows = np.flatnonzero(beyond.any(axis=1))
        if not len(rows):
            return None
        step = int(rows[0])
        columns = np.flatnonzero(beyond[step]).tolist()
        most = max(columns, key=lambda column: float(off[step, column]))
        bodies = [*dict.fromkeys(self.labels[column] for column in columns)]
        size = float(off[step, most])
        return First(step, float(self.times_s[step]), bodies, size, self.units[most])

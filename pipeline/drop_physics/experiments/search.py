"""Searches for single changes with which a run would meet an expectation.

A kind of change is tried on all elements at once, then on each element, then with the least factor
that suffices. If no change meets the expectation, the square root of each factor is tried, too, and
both sides of a root that comes nearer than its factor. A change is not reported if a part of it
suffices.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from drop_physics.engines.source import SOURCE, converts_unit, paces
from drop_physics.engines.watching.single_changes import ORDERS, Change
from drop_physics.experiments.motion import (
    RunMotion,
    apart_m,
    is_still,
    size_m,
    thrown,
    worse,
)
from drop_physics.experiments.verdicts import BEYOND

ONE_BY_ONE = 8
"""Most elements that are tried one by one; larger sets are split into halves."""
HALVINGS = 4
"""Number of bisection steps for a least factor: its logarithm is found to a sixteenth of the
logarithm of the factor tried."""
ROUNDING = 1e-9
"""Relative difference up to which two sums count as equal."""
NEARBY = 1.05
"""Ratio between a factor and its neighbours, one of which must also meet the expectation."""
NARROWED = 3
"""Number of changes that are bisected and tested further: the first ones reported."""
THROWN = 5.0
"""A change of the text that moves a body by more than this multiple of the scene's size counts as
throwing the body away, which destroys the scene."""
LASTS = 0.01
"""Largest relative difference of the simulated time if a change sets the timestep; a change beyond
it alters the question instead of the answer."""
MOST_MOVERS = 12
"""Most kinds of changes that only move the quantity, and are tried element by element."""
MOST_PEAKS = 4
"""Most factors that are tried on both sides of their root."""


@dataclass(frozen=True)
class ChangeOutcome:
    """The outcome of a run: whether it met the expectation, and by which margin."""

    holds: bool
    """Whether the expectation was met, in a run that ended like the script's own, with finite
    numbers."""
    margin: float
    """Margin by which the expectation is met; negative if it is not."""
    value: float
    """Value of the compared quantity."""
    motion: Sequence[RunMotion] = ()

    def is_across(self, other: ChangeOutcome) -> bool:
        """Return whether the expected number lies between the quantities of this and another run.

        With `==`, runs on either side of that number fail alike.
        """
        missing = abs(self.margin) + abs(other.margin)
        return 0 < missing <= (1 + ROUNDING) * abs(other.value - self.value)

    def off(self, other: ChangeOutcome) -> float:
        """Return how far the quantity of another run is from this one's, if finite.

        With `==`, quantities on both sides of the expected number can have the same margin, so that
        the quantities are compared, too.
        """
        far = abs(other.margin - self.margin), abs(other.value - self.value)
        return max(filter(math.isfinite, far), default=0.0)


@dataclass(frozen=True)
class TriedChange:
    """A change that was tried, and its outcome."""

    change: Change
    outcome: ChangeOutcome
    number: int
    """Position in the order of trials."""
    far_m: Mapping[str, float]
    """RMS distance of each body from the script's own run [m]."""
    worse: Sequence[str] = ()
    """The commands followed less well than in the script's own run."""
    thrown: tuple[str, float] | None = None
    """The fastest body and its speed [m/s], if far above all speeds in the script's own run."""

    @property
    def family(self) -> tuple[Any, ...]:
        """The kind of change, without the elements that it acts on."""
        return self.change.change, self.change.op, self.change.site


Run = Callable[[Iterator[Change]], Iterable[tuple[Change, ChangeOutcome | None]]]
"""Function that runs a script with changes, and yields their outcomes as they arrive: None if no
time is left. The function takes the next change whenever a run can start, even if the iterator was
exhausted before."""


@dataclass(frozen=True)
class BranchedTrial:
    """Results of a change that is made only a second before a failure."""

    open_loop: bool | None = None
    """Whether the expectation is met with the recorded commands. None if unknown: for a change that
    has to begin with the run or has no effect that late, and for all changes if an unchanged run
    with the recorded commands is not bitwise equal to the recorded run."""
    closed_loop: bool | None = None
    """Whether the expectation is met with the script's controller; None for a change that has to
    begin with the run or has no effect that late."""


@dataclass
class Search:
    """A search for changes that meet an expectation.

    Parameters
    ----------
    base
        The outcome of the script's own run.
    run
        Function that runs the script with changes.
    noise
        Largest change of the margin by a nudge.
    told
        Called with the number of changes tried so far, and the number that meet the expectation.
    """

    base: ChangeOutcome
    run: Run
    noise: float = 0.0
    told: Callable[[int, int], object] = lambda *_: None
    tried: list[TriedChange] = field(default_factory=list)
    _queue: _Queue = field(default_factory=lambda: _Queue())
    complete: bool = True
    """Whether nothing was left out for lack of time."""

    def all_of(self, changes: Sequence[Change]) -> None:
        """Try changes in the given order, each first on all of its elements together.

        Changes of an earlier call are not tried again.
        """
        queue, before = self._queue, len(self.tried)
        for change in changes:
            queue.put(change, 1)
        self._drain(queue)
        several = (each for each in self.tried[before:] if len(each.change.ids) > 1)
        moving = filter(self.moves, several)
        nearest = sorted(moving, key=lambda each: (-each.outcome.margin, each.number))
        for each in [each for each in nearest if not each.outcome.holds][:MOST_MOVERS]:
            for part in _parts(each.change):
                queue.put(part, 2)
        self._drain(queue)
        if not self._has_found:
            factors = self._factors(self.tried[before:])  # ten times may be too much
            roots = self._powers(factors, 0.5)
            if not self._has_found:  # the best factor may be on either side of the root
                peaks = [(root, each) for root, each in roots if self._is_peak(root, each)]
                peaks.sort(key=lambda pair: -pair[0].outcome.margin)
                self._powers([each for _, each in peaks[:MOST_PEAKS]], 0.25, 0.75)

    @property
    def _has_found(self) -> bool:
        """True if a change that removes nothing meets the expectation."""
        return any(each.outcome.holds and not each.change.breaks for each in self.tried)

    def _powers(
        self, factors: Sequence[TriedChange], *powers: float
    ) -> list[tuple[TriedChange, TriedChange]]:
        """Try powers of factors; return each result with that of the factor itself."""
        of: dict[Any, TriedChange] = {}
        for each in factors:
            for power in powers:
                change = each.change.by(float(f"{each.change.how[1] ** power:.3g}"))
                of[change.key] = each
                self._queue.put(change, 2)
        before = len(self.tried)
        self._drain(self._queue)
        tried = self.tried[before:]
        return [(each, of[each.change.key]) for each in tried if each.change.key in of]

    def _is_peak(self, root: TriedChange, each: TriedChange) -> bool:
        """Return whether the root of a factor comes nearer to the expectation than the factor."""
        return root.outcome.margin > max(each.outcome.margin, self.base.margin)

    def least_of(self, each: TriedChange) -> float | None:
        """Return the smallest factor that still meets the expectation; None for other changes.

        Factors are rounded to three digits before they are tried, as they are printed.
        """
        operator, factor = each.change.how
        if operator != "*" or factor <= 0:
            return None
        fails, holds, least = 0.0, 1.0, float(factor)  # shares of the factor's logarithm
        for _ in range(HALVINGS):
            middle = (fails + holds) / 2
            less = float(f"{factor**middle:.3g}")
            for _, outcome in self.run(iter([each.change.by(less)])):
                if outcome is None:
                    return None
                if outcome.holds:
                    holds, least = middle, less
                else:
                    fails = middle
        return least

    def is_alone(self, each: TriedChange) -> bool:
        """Return whether slightly larger and smaller factors both fail, so success is chance.

        The factor between two units is not one of many that could have been tried.
        """
        operator, factor = each.change.how
        if operator != "*" or converts_unit(each.change):
            return False
        near = [each.change.by(factor * NEARBY), each.change.by(factor / NEARBY)]
        outcomes = [outcome for _, outcome in self.run(iter(near))]
        return not any(outcome is None or outcome.holds for outcome in outcomes)

    def moves(self, each: TriedChange) -> bool:
        """Return whether a change moves the quantity more than slight displacements do."""
        far = abs(each.outcome.margin - self.base.margin)
        return math.isfinite(far) and far > BEYOND * self.noise + 1e-12

    def _factors(self, tried: Iterable[TriedChange]) -> list[TriedChange]:
        """Return the factors that move the quantity: nearest and farthest, in each direction."""
        moving = [
            each
            for each in tried
            if each.change.how[0] == "*" and each.change.how[1] > 0 and self.moves(each)
        ]
        order = sorted(moving, key=lambda each: -each.outcome.margin)
        return [*order[:MOST_MOVERS], *order[MOST_MOVERS:][-MOST_MOVERS:][::-1]]

    def movers(self) -> list[TriedChange]:
        """Return the changes that move the quantity as expected, the largest effect first."""
        near = [each for each in self.tried if self.moves(each) and not each.outcome.holds]
        near = [each for each in near if each.outcome.margin > self.base.margin]
        return sorted(near, key=lambda each: -each.outcome.margin)

    def _lasts_as_long(self, outcome: ChangeOutcome) -> bool:
        """Return whether a run simulates as much time as the unchanged one, if that is known."""
        own_s, its_s = (
            sum(each.duration_s for each in motion) for motion in (self.base.motion, outcome.motion)
        )
        return not own_s or math.isclose(its_s, own_s, rel_tol=LASTS)

    @property
    def _size_m(self) -> float:
        """Size of the scene in the unchanged run [m]."""
        return max(map(size_m, self.base.motion), default=0.0)

    def _drain(self, queue: _Queue) -> None:
        for change, outcome in self.run(queue):
            if outcome is None:
                self.complete = False
                continue
            far_m = apart_m(self.base.motion, outcome.motion)
            follows = worse(self.base.motion, outcome.motion)
            number = queue.number(change)
            if change.engine == SOURCE:
                # Another number is told, or sooner.
                if is_still(far_m) or (paces(change) and not self._lasts_as_long(outcome)):
                    outcome = replace(outcome, holds=False)
                apart = max(far_m.values(), default=0.0) > THROWN * self._size_m
                change = replace(change, breaks=change.breaks or apart)
            throws = thrown(self.base.motion, outcome.motion)
            each = TriedChange(change, outcome, number, far_m, follows, throws)
            self.tried.append(each)
            self.told(len(self.tried), sum(one.outcome.holds for one in self.tried))
            if outcome.holds:
                for part in _parts(change):
                    queue.put(part, 0)


class _Queue(Iterator[Change]):
    """A priority queue of changes to try; more may be added after the last one was taken."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, Change]] = []
        self._numbers: dict[int, int] = {}
        """Positions in the order of trials, by the `id` of changes, which are all kept alive."""
        self._all: list[Change] = []
        self._keys: set[tuple[object, ...]] = set()

    def number(self, change: Change) -> int:
        """Return the position of a change in the order of trials."""
        return self._numbers[id(change)]

    def put(self, change: Change, urgency: int) -> None:
        """Add a change to the queue, once; urgency 0 comes first."""
        if change.key in self._keys:
            return
        self._keys.add(change.key)
        self._numbers[id(change)] = number = len(self._all)
        self._all.append(change)
        heapq.heappush(self._heap, (urgency, number, change))

    def __next__(self) -> Change:
        if not self._heap:
            raise StopIteration
        return heapq.heappop(self._heap)[-1]


def _parts(change: Change) -> list[Change]:
    """Split a change into its single elements, or two halves; empty if it has only one element."""
    number = len(change.ids)
    if number < 2 or change.op in ORDERS:
        return []
    if number <= ONE_BY_ONE:
        return [change.of_some([place]) for place in range(number)]
    half = number // 2
    return [change.of_some(range(half)), change.of_some(range(half, number))]

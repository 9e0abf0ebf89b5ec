"""A causal search: single changes that make an expectation of a run true.

A kind of change is tried on all elements at once, then on each of them, then with the least factor
that suffices; where none makes it true, factors are tried by their roots, too. A change of which a
part makes it true is not reported.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from drop_physics.engines.source import SOURCE
from drop_physics.engines.watching.single_changes import ORDERS, Change
from drop_physics.experiments.motion import RunMotion, apart_m, is_still, size_m, worse

ONE_BY_ONE = 8
"""So many elements are tried one by one; more of them by halves."""
HALVINGS = 4
"""Trials that narrow a least factor: its logarithm to a sixteenth of that of the factor tried."""
NEARBY = 1.05
"""Factor between a factor and those beside it, one of which has to make it true, too."""
NARROWED = 3
"""Number of changes that are narrowed: the first ones reported."""
NOISE = 10.0
"""A change moves the quantity where it does so by this many times what nudges do."""
THROWN = 5.0
"""A change of the text with which a body goes farther from its way than so many times the size of
the scene throws it away: that takes the scene apart."""
MOST_MOVERS = 12
"""Number of kinds that move the quantity without making it true, and are tried by element."""


@dataclass(frozen=True)
class ChangeOutcome:
    """The outcome of a run: whether the expectation held, and its margin."""

    holds: bool
    """Whether it did, in a run that ended as the script's own, in finite numbers."""
    margin: float
    """The margin by which it holds; below 0 where it does not."""
    value: float
    """The quantity that is compared."""
    motion: Sequence[RunMotion] = ()


@dataclass(frozen=True)
class TriedChange:
    """A change that was tried."""

    change: Change
    outcome: ChangeOutcome
    number: int
    """Place in the order of trials."""
    far_m: Mapping[str, float]
    """RMS distance of the bodies from the script's own run [m]."""
    worse: Sequence[str] = ()
    """The commands that are followed worse than there."""

    @property
    def family(self) -> tuple[Any, ...]:
        """The kind of change, whatever its elements."""
        return self.change.change, self.change.op, self.change.site


Run = Callable[[Iterator[Change]], Iterable[tuple[Change, ChangeOutcome | None]]]
"""Runs a script with changes, and yields their outcomes as they come: None where no time is left.
It asks for another change whenever it has room, also after there was none."""


@dataclass
class Search:
    """A search for changes that make an expectation true.

    Parameters
    ----------
    base
        The outcome of the script's own run.
    run
        Makes runs.
    noise
        How far nudges have moved the margin.
    told
        Called with the numbers of changes that were tried, and of those that make it true.
    """

    base: ChangeOutcome
    run: Run
    noise: float = 0.0
    told: Callable[[int, int], object] = lambda *_: None
    tried: list[TriedChange] = field(default_factory=list)
    _queue: _Queue = field(default_factory=lambda: _Queue())
    complete: bool = True
    """Whether nothing was left out for want of time."""

    def all_of(self, changes: Sequence[Change]) -> None:
        """Try changes in this order, first on all of their elements.

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
        if not any(each.outcome.holds and not each.change.breaks for each in self.tried):
            for each in self._factors(self.tried[before:]):  # ten times may be too much
                root = math.sqrt(each.change.how[1])
                queue.put(each.change.by(float(f"{root:.3g}")), 2)
            self._drain(queue)

    def least_of(self, each: TriedChange) -> float | None:
        """Return the least factor that makes it true; None if the change is no factor."""
        operator, factor = each.change.how
        if operator != "*" or factor <= 0:
            return None
        fails, holds = 0.0, 1.0  # as shares of the factor's logarithm
        for _ in range(HALVINGS):
            middle = (fails + holds) / 2
            changed = each.change.by(factor**middle)
            for _, outcome in self.run(iter([changed])):
                if outcome is None:
                    return None
                fails, holds = (fails, middle) if outcome.holds else (middle, holds)
        return float(factor**holds)

    def is_alone(self, each: TriedChange) -> bool:
        """Return whether neither a larger nor a smaller factor close by makes it true."""
        operator, factor = each.change.how
        if operator != "*":
            return False
        near = [each.change.by(factor * NEARBY), each.change.by(factor / NEARBY)]
        outcomes = [outcome for _, outcome in self.run(iter(near))]
        return not any(outcome is None or outcome.holds for outcome in outcomes)

    def moves(self, each: TriedChange) -> bool:
        """Return whether a change moves the quantity by more than chance does."""
        far = abs(each.outcome.margin - self.base.margin)
        return math.isfinite(far) and far > NOISE * self.noise + 1e-12

    def _factors(self, tried: Iterable[TriedChange]) -> list[TriedChange]:
        """Return factors that move the quantity, either way: the nearest, and the farthest."""
        moving = [
            each
            for each in tried
            if each.change.how[0] == "*" and each.change.how[1] > 0 and self.moves(each)
        ]
        order = sorted(moving, key=lambda each: -each.outcome.margin)
        return [*order[:MOST_MOVERS], *order[MOST_MOVERS:][-MOST_MOVERS:][::-1]]

    def movers(self) -> list[TriedChange]:
        """Return the changes that move the quantity the expected way, the farthest first."""
        near = [each for each in self.tried if self.moves(each) and not each.outcome.holds]
        near = [each for each in near if each.outcome.margin > self.base.margin]
        return sorted(near, key=lambda each: -each.outcome.margin)

    @property
    def _size_m(self) -> float:
        """The size of what the script's own run is about [m]."""
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
                if is_still(far_m):  # another number is told, or sooner
                    outcome = replace(outcome, holds=False)
                apart = max(far_m.values(), default=0.0) > THROWN * self._size_m
                change = replace(change, breaks=change.breaks or apart)
            each = TriedChange(change, outcome, number, far_m, follows)
            self.tried.append(each)
            self.told(len(self.tried), sum(one.outcome.holds for one in self.tried))
            if outcome.holds:
                for part in _parts(change):
                    queue.put(part, 0)


class _Queue(Iterator[Change]):
    """Changes to try, the most urgent first; more may come after the last one was taken."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, Change]] = []
        self._numbers: dict[int, int] = {}
        """Places in the order by the `id` of changes, which all are kept."""
        self._all: list[Change] = []

    def number(self, change: Change) -> int:
        """Return the place of a change in the order."""
        return self._numbers[id(change)]

    def put(self, change: Change, urgency: int) -> None:
        """Put a change into the queue; 0 is the most urgent."""
        self._numbers[id(change)] = number = len(self._all)
        self._all.append(change)
        heapq.heappush(self._heap, (urgency, number, change))

    def __next__(self) -> Change:
        if not self._heap:
            raise StopIteration
        return heapq.heappop(self._heap)[-1]


def _parts(change: Change) -> list[Change]:
    """Split a change into its elements, or into halves of them; nothing for a single one."""
    number = len(change.ids)
    if number < 2 or change.op in ORDERS:
        return []
    if number <= ONE_BY_ONE:
        return [change.of_some([place]) for place in range(number)]
    half = number // 2
    return [change.of_some(range(half)), change.of_some(range(half, number))]

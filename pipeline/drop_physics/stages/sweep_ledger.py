"""The shards of a sweep that are done, and whether they are enough."""

from __future__ import annotations

from collections.abc import Callable

from drop_physics.drop.statistics import Moments
from drop_physics.stages.sweep_shard import ShardDone
from drop_physics.sweeping.plan import Plan

LEAST_SAMPLES = 30
"""Least number of samples for `--until-ci`. Of fewer, 95 % intervals that are checked after each
sample cover the mean of a uniform distribution in 83 to 92 % of all sweeps, from 30 on in 94 to
95 %."""

Progress = Callable[[int, int, int], None]
"""Called with the number of runs that are done, of those that failed, and of all."""


class Ledger:
    """The shards that are done, and whether they are enough.

    Shards finish in any order. Only the first ones without a gap decide whether they are enough, so
    that the answer is the same for any number of workers.
    """

    def __init__(
        self, plan: Plan, done: dict[int, ShardDone], until_ci_m: float | None, progress: Progress
    ) -> None:
        self.shards = plan.shards
        """Number of shards that are needed, as far as is known."""
        self.enough = False
        """Whether these are fewer than all."""
        self.narrow = False
        """Whether the interval is narrow enough after the shards followed so far."""
        self.runs = sum(shard.runs for shard in done.values())
        self._failed = sum(shard.failed for shard in done.values())
        self._plan, self._done, self._until_ci_m, self._progress = plan, done, until_ci_m, progress
        self._followed, self._errors, self._explained = 0, Moments(), Moments()
        self._follow()

    def enter(self, shard: int, done: ShardDone) -> None:
        """Add a shard."""
        self._done[shard] = done
        self.runs += done.runs
        self._failed += done.failed
        self._follow()

    def _follow(self) -> None:
        self._progress(self.runs, self._failed, self._plan.runs)
        while not self.enough and self._until_ci_m is not None and self._followed in self._done:
            done = self._done.pop(self._followed)
            self._errors = self._errors.merged(done.error_m)
            self._explained = self._explained.merged(done.explained_m)
            self._followed += 1
            # Over the same samples as the statistics.
            samples = self._explained if self._explained.count else self._errors
            if samples.count < LEAST_SAMPLES or (interval := samples.interval) is None:
                continue
            # Equal samples do not say how much the next one differs.
            self.narrow = interval[1] - interval[0] <= self._until_ci_m
            if self.narrow and samples.squares > 0:
                self.shards, self.enough = self._followed, True

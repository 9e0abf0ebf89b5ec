"""Times of a script's steps: the timesteps before each, added up."""

from __future__ import annotations

import bisect

import numpy as np
from numpy.typing import NDArray

from drop_physics.trace.events import counted_s
from drop_physics.trace.history import Seen


class Times:
    """Times of the steps of one simulation, which may change its timestep."""

    def __init__(self, seen: Seen, client: int) -> None:
        settings = [each for each in seen.settings if each.client == client]
        self._steps = np.array([each.at.step for each in settings], np.int64)
        self._times_s = np.array([each.at.time_s for each in settings], np.float64)
        self._timesteps_s = np.array(
            [counted_s(float(np.ravel(each.values["fixedTimeStep"])[0])) for each in settings]
        )

    def of_all(self, steps: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the times of steps [s]."""
        which = np.maximum(0, np.searchsorted(self._steps, steps - 1, side="right") - 1)
        since_s: NDArray[np.float64] = (steps - self._steps[which]) * self._timesteps_s[which]
        return self._times_s[which] + since_s

    def of(self, step: int) -> float:
        """Return the time of a step [s]."""
        return float(self.of_all(np.array([step]))[0])

    def nearest(self, time_s: float, first: int, last: int) -> int | None:
        """Return the step from `first` to `last` nearest to a time; None if that is outside."""
        if not self.of(first) <= time_s <= self.of(last):
            return None
        low = bisect.bisect_left(range(first, last + 1), time_s, key=self.of) + first
        near = [step for step in (low - 1, low) if first <= step <= last]
        return min(near, key=lambda step: abs(self.of(step) - time_s))

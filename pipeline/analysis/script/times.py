"""When a step of a script was: the timesteps before it, added up."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence

import numpy as np

from pipeline.seen import Seen, Settings


class Times:
    """Times of the steps of one simulation, which may change its timestep on the way."""

    def __init__(self, seen: Seen, client: int) -> None:
        self._settings: Sequence[Settings] = [one for one in seen.settings if one.client == client]
        self._steps = [one.at.step for one in self._settings]

    def of(self, step: int) -> float:
        """Return the time of a step [s]."""
        number = max(0, bisect.bisect_right(self._steps, step - 1) - 1)
        told = self._settings[number]
        timestep_s = float(np.ravel(told.values["fixedTimeStep"])[0])
        if not math.isfinite(timestep_s):  # no time passes then
            timestep_s = 0.0
        return told.at.time_s + (step - told.at.step) * timestep_s

    def nearest(self, time_s: float, first: int, last: int) -> int | None:
        """Return the step nearest to a time, of those from `first` to `last`; None outside."""
        if not self.of(first) <= time_s <= self.of(last):
            return None
        low = bisect.bisect_left(range(first, last + 1), time_s, key=self.of) + first
        near = [step for step in (low - 1, low) if first <= step <= last]
        return min(near, key=lambda step: abs(self.of(step) - time_s))

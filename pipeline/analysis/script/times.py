"""Times of a script's steps: the timesteps before each, added up."""

from __future__ import annotations

import bisect
from collections.abc import Sequence

import numpy as np

from pipeline.seen import Seen, Settings, counted_s


class Times:
    """Times of the steps of one simulation, which may change its timestep."""

    def __init__(self, seen: Seen, client: int) -> None:
        self._settings: Sequence[Settings] = [
            settings for settings in seen.settings if settings.client == client
        ]
        self._steps = [settings.at.step for settings in self._settings]

    def of(self, step: int) -> float:
        """Return the time of a step [s]."""
        number = max(0, bisect.bisect_right(self._steps, step - 1) - 1)
        settings = self._settings[number]
        timestep_s = float(np.ravel(settings.values["fixedTimeStep"])[0])
        return settings.at.time_s + (step - settings.at.step) * counted_s(timestep_s)

    def nearest(self, time_s: float, first: int, last: int) -> int | None:
        """Return the step from `first` to `last` nearest to a time; None if that is outside."""
        if not self.of(first) <= time_s <= self.of(last):
            return None
        low = bisect.bisect_left(range(first, last + 1), time_s, key=self.of) + first
        near = [step for step in (low - 1, low) if first <= step <= last]
        return min(near, key=lambda step: abs(self.of(step) - time_s))

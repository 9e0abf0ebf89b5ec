"""Timestep, gravity and time of each step, even if the script changes them."""

from __future__ import annotations

import bisect

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64, Int64
from drop_physics.trace.events import counted_s
from drop_physics.trace.history import Seen

ENGINE = ("fixedTimeStep", *(f"gravityAcceleration{axis}" for axis in "XYZ"))


class StepTimes:
    """Times of the steps of one simulation, whose timestep may change."""

    def __init__(self, seen: Seen, client: int) -> None:
        settings = [each for each in seen.settings if each.client == client]
        self._steps = np.array([each.at.step for each in settings], np.int64)
        self._times_s = np.array([each.at.time_s for each in settings], np.float64)
        numbers = [[float(np.ravel(each.values[name])[0]) for name in ENGINE] for each in settings]
        held = np.reshape(numbers, (-1, len(ENGINE)))
        self._timesteps_s = np.array([*map(counted_s, held[:, 0].tolist())])
        self._gravity_m_s2 = held[:, 1:]

    def of_steps(self, ends: Int64) -> tuple[Float64, Float64]:
        """Return timestep [s] and gravity [m/s²] in given steps, shapes (n,) and (n, 3)."""
        which = self._latest(ends)
        return self._timesteps_s[which], self._gravity_m_s2[which]

    def _latest(self, ends: Int64) -> NDArray[np.intp]:
        """Return the index of the settings in effect at the start of each step, (n,)."""
        return np.maximum(0, np.searchsorted(self._steps, ends - 1, side="right") - 1)

    def of_all(self, steps: Int64) -> Float64:
        """Return the times of steps [s]."""
        which = self._latest(steps)
        since_s: Float64 = (steps - self._steps[which]) * self._timesteps_s[which]
        return self._times_s[which] + since_s

    def of(self, step: int) -> float:
        """Return the time of a step [s]."""
        return float(self.of_all(np.array([step]))[0])

    @property
    def falls(self) -> bool:
        """Whether gravity ever acted."""
        return bool(self._gravity_m_s2.any())

    @property
    def changes(self) -> list[tuple[int, float, float]]:
        """Steps after which the timestep changed, with the timesteps before and after [s]."""
        around = zip(self._steps[1:], self._timesteps_s[:-1], self._timesteps_s[1:], strict=True)
        return [(int(step), float(a), float(b)) for step, a, b in around if a != b]

    def nearest(self, time_s: float, first: int, last: int) -> int | None:
        """Return the step from `first` to `last` nearest to a time; None if the time is outside."""
        if not self.of(first) <= time_s <= self.of(last):
            return None
        low = bisect.bisect_left(range(first, last + 1), time_s, key=self.of) + first
        near = [step for step in (low - 1, low) if first <= step <= last]
        return min(near, key=lambda step: abs(self.of(step) - time_s))

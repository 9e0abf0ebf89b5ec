"""When the body falls, touches and rests, read from the recorded samples alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import polars as pl
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Phase = Literal["falling", "contact", "rest"]

REST_SPEED_M_S = 1e-3
"""A body in contact and slower than this at the end of the recording has come to rest."""
SETTLED_M = 1e-5
"""A body within this of its final height has settled: Bullet's own contact slop."""


@dataclass(frozen=True)
class Phases:
    """The samples at which the phase changes; None where it never does."""

    samples: int
    contact_step: int | None
    """First sample that a contact has acted on."""
    rest_step: int | None
    """First sample from which on the body lies still."""

    @property
    def airborne(self) -> int:
        """How many samples there are before the first contact."""
        return self.samples if self.contact_step is None else self.contact_step

    def at(self, step: int) -> Phase:
        """Return the phase of a sample."""
        if step < self.airborne:
            return "falling"
        return "contact" if self.rest_step is None or step < self.rest_step else "rest"

    def column(self) -> pl.Series:
        """Return the phase of every sample."""
        rest_step = self.samples if self.rest_step is None else self.rest_step
        lengths = (self.airborne, rest_step - self.airborne, self.samples - rest_step)
        return pl.concat(
            pl.repeat(phase, length, dtype=pl.String, eager=True)
            for phase, length in zip(get_args(Phase), lengths, strict=True)
        )


def phases(height_m: Float64, speed_m_s: Float64, contact_points: Float64) -> Phases:
    """Find the phases of a fall.

    Parameters
    ----------
    height_m, speed_m_s, contact_points
        Height of the centre [m], speed [m/s] and number of contact points, of shape (samples,).
    """
    touching = np.flatnonzero(contact_points > 0)
    if not len(touching):
        return Phases(len(height_m), None, None)
    contact_step, rest_step = int(touching[0]), None
    if contact_points[-1] > 0 and speed_m_s[-1] < REST_SPEED_M_S:
        moving = np.flatnonzero(np.abs(height_m - height_m[-1]) > SETTLED_M)
        rest_step = max(contact_step, int(moving[-1]) + 1 if len(moving) else 0)
    return Phases(len(height_m), contact_step, rest_step)


def crossing_time(height_m: Float64, floor_height_m: float, timestep_s: float) -> float | None:
    """Return when the simulated centre first comes down through a height [s], or None.

    Between two samples Bullet moves the body with one velocity, so the straight line between them
    is the simulation's own path, not an interpolation.
    """
    above = height_m > floor_height_m
    crossings = np.flatnonzero(above[:-1] & ~above[1:])
    if not len(crossings):
        return None
    step = int(crossings[0])
    fallen = height_m[step] - floor_height_m
    return float((step + fallen / (height_m[step] - height_m[step + 1])) * timestep_s)

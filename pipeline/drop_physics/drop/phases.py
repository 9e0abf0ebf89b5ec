"""Phases of a drop (falling, contact, rest), from the recorded samples alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import polars as pl

from drop_physics.arrays import Flags, Int64
from drop_physics.drop.case import DropCase
from drop_physics.drop.samples import DropSamples
from drop_physics.physics.base import Motion
from drop_physics.physics.vectors import largest

Phase = Literal["falling", "contact", "rest"]

SETTLED_M = 1e-5
"""Distance from its last position along each axis within which a body counts as settled [m]:
Bullet's contact slop."""
SETTLED_RAD = 1e-3
"""Difference of orientation within which a body counts as settled [rad]: half of it moves the
surface of a 5 cm box by the slop."""
REST_S, REST_SAMPLES = 0.1, 10
"""Smallest duration [s], and number of samples, for which a body must be settled at the end of the
recording to count as lying still."""
CREEP = 0.25
"""Share of the tolerances of settling by which a body at rest may move in the second half of the
time in which it lies still. A body that creeps or spins at a constant rate moves by half of them,
however slow it is, and seems to settle wherever the recording ends. Of 140 bodies that lay still,
drawn as in `tests/test_truth.py`, most moved by a share of 0.00 or 0.50, and none by 0.22 to 0.30.
"""


@dataclass(frozen=True)
class Phases:
    """The samples at which the phase changes; None for a change that never happens."""

    samples: int
    contact_step: int | None
    """First sample in which the body touches the floor."""
    rest_step: int | None
    """First sample from which on the body lies still; None if it keeps creeping."""
    lies: bool
    """Whether the body stays where it is until the end, at rest or creeping."""

    @property
    def airborne(self) -> int:
        """Number of samples before the first contact."""
        return self.samples if self.contact_step is None else self.contact_step

    def of(self, steps: Int64) -> pl.Series:
        """Return the phase of each sample."""
        rest_step = self.samples if self.rest_step is None else self.rest_step
        which = np.searchsorted([self.airborne, rest_step], steps, side="right")
        return pl.Series(get_args(Phase)).gather(which)


class Settling:
    """Finds the sample from which a body stays at its final place; samples are added in order."""

    def __init__(self, case: DropCase) -> None:
        self._case = case
        self._touched: int | None = None
        """The first sample in which the body touches the floor."""
        self._settled = 0
        """The first sample after the body was last elsewhere."""

    def add(self, part: DropSamples) -> int | None:
        """Add samples; return the first from which on the body seems to lie still."""
        touching = np.flatnonzero(part.touching)
        if self._touched is None and len(touching):
            self._touched = part.first + int(touching[0])
        moving = np.flatnonzero(_moving(part, self._case.end))
        if not len(moving):
            return None
        self._settled = part.first + int(moving[-1]) + 1
        return self._settled

    def phases(self, contact_step: int | None) -> Phases:
        """Return when the body touched and settled, once all samples are added."""
        case, rest_step, lies = self._case, None, False
        if self._touched is not None and case.is_rigid and case.end.contact_points[0] > 0:
            settled = max(self._touched, self._settled)
            lasts = case.samples - 1 - settled
            lies = lasts >= REST_SAMPLES and lasts * case.timestep_s >= REST_S * (1 - 1e-9)
            if lies and not _moving(case.sample(settled + lasts // 2), case.end, CREEP)[0]:
                rest_step = settled
        return Phases(case.samples, contact_step, rest_step, lies)


def _moving(part: Motion, end: Motion, share: float = 1.0) -> Flags:
    """Flag the samples that differ from the last in position or orientation, shape (samples,).

    The difference counts if it exceeds `share` times the tolerances of settling.
    """
    way_m = largest(part.position_m - end.position_m[0])
    # |q·q'| of two orientations a turn by θ apart is cos(θ/2).
    agree = np.abs(part.orientation @ end.orientation[0])
    turn_rad = 2 * np.arccos(np.minimum(agree, 1.0))
    return np.asarray((way_m > share * SETTLED_M) | (turn_rad > share * SETTLED_RAD))

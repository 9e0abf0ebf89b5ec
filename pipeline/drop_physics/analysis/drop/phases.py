"""When the body falls, touches and rests, from the recorded samples alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.analysis.drop.case import Case
from drop_physics.analysis.drop.samples import Samples, blocks
from drop_physics.laws.vectors import largest

Float64 = NDArray[np.float64]
Phase = Literal["falling", "contact", "rest"]

SETTLED_M = 1e-5
"""A body within this of its last position, along each axis, has settled: Bullet's contact slop."""
SETTLED_RAD = 1e-3
"""The same for its orientation: half of it moves the surface of a 5 cm box by the slop."""
REST_S, REST_SAMPLES = 0.1, 10
"""A body lies if it stays settled for at least this long, up to the end of the recording."""
CREEP = 0.25
"""It rests if, in the second half of that time, it moves by at most this share of what counts as
settled. A body that creeps or spins at a constant rate moves by half of it, however slowly, and
seems to settle wherever the recording ends. Of 140 bodies that lay, drawn as in
`tests/test_truth.py`, most moved by 0.00 or by 0.50, none by 0.22 to 0.30."""


@dataclass(frozen=True)
class Phases:
    """The samples at which the phase changes; None where it never does."""

    samples: int
    contact_step: int | None
    """First sample that touches the floor."""
    rest_step: int | None
    """First sample from which on the body lies still; None where it keeps creeping."""
    lies: bool
    """Whether the body stays where it is to the end, at rest or creeping."""

    @property
    def airborne(self) -> int:
        """Number of samples before the first contact."""
        return self.samples if self.contact_step is None else self.contact_step

    def of(self, steps: NDArray[np.int64]) -> pl.Series:
        """Return the phases of samples."""
        rest_step = self.samples if self.rest_step is None else self.rest_step
        which = np.searchsorted([self.airborne, rest_step], steps, side="right")
        return pl.Series(get_args(Phase)).gather(which)


def touching(samples: Samples) -> NDArray[np.bool_]:
    """Return which samples touch the floor: a contact pushed, or the shapes overlapped.

    A contact point alone is not a touch: Bullet keeps points up to 20 mm above the floor.
    """
    with np.errstate(invalid="ignore"):  # no contact, no distance
        return samples.pushed | (samples.contact_distance_m <= 0)


def phases_of(case: Case) -> Phases:
    """Find the phases of a drop."""
    samples = case.samples
    touches = touching(samples)
    first = np.flatnonzero(touches)
    if not len(first):
        return Phases(len(touches), None, None, lies=False)
    contact_step, rest_step, lies = int(first[0]), None, False
    if case.is_rigid and samples.contact_points[-1] > 0:
        moving = np.flatnonzero(_moving(samples))
        settled = max(contact_step, int(moving[-1]) + 1 if len(moving) else 0)
        lasts = len(touches) - 1 - settled
        lies = lasts >= REST_SAMPLES and lasts * case.timestep_s >= REST_S * (1 - 1e-9)
        if lies and not _moving(samples, CREEP)[settled + lasts // 2]:
            rest_step = settled
    return Phases(len(touches), contact_step, rest_step, lies)


def _moving(samples: Samples, share: float = 1.0) -> NDArray[np.bool_]:
    """Return which samples differ from the last in position or orientation, shape (samples,).

    By more than this share of what counts as settled.
    """
    moving = np.empty(len(samples), np.bool_)
    for rows in blocks(len(samples)):
        way_m = largest(samples.position_m[rows] - samples.position_m[-1])
        # |q·q'| of two orientations a turn by θ apart is cos(θ/2).
        agree = np.abs(samples.orientation[rows] @ samples.orientation[-1])
        turn_rad = 2 * np.arccos(np.minimum(agree, 1.0))
        moving[rows] = (way_m > share * SETTLED_M) | (turn_rad > share * SETTLED_RAD)
    return moving


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

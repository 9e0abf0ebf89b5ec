"""Follows a fall chunk by chunk: positions, tilt and contacts."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.drop.air import Air
from drop_physics.drop.case import DropCase
from drop_physics.drop.phases import Phases, Settling
from drop_physics.drop.posture import FLAT_RAD, extent_m, tilt_rad, turned_rad
from drop_physics.drop.results import Impact, Landing
from drop_physics.drop.samples import DropSamples
from drop_physics.drop.touchdowns import Touchdowns
from drop_physics.physics.base import Motion

ROUGH_M = 1e-6
"""Largest amount by which a contact point may be deeper than the centre's height implies [m]."""


class Course:
    """The motion of a fall; samples are added in order."""

    def __init__(self, case: DropCase) -> None:
        self.case, self.air, self.touchdowns = case, Air(case), Touchdowns(case)
        self.lowest: tuple[Motion, int] | None = None
        """The sample with the lowest centre, and its index; the first, if there are several."""
        self.tumbled_step: int | None = None
        """The first sample in which the body touches the floor tilted; None if it never does."""
        self.through: tuple[Motion, int] | None = None
        """The last sample before the whole body was below the floor without contact, and the index
        of the sample after it.
        """
        self.overlapped = case.floor_height_m is None
        """Whether a sample before the body was entirely below the floor shows it partly inside;
        also True if the body cannot touch the floor."""
        self.altered: list[int] = []
        """Index of the first sample that differs from the release, and the number of such samples.
        """
        self._settling = Settling(case)
        self._last: Motion | None = None
        self.arriving: Motion = case.start
        """The last sample before the first contact."""
        self._upright, self._beside = True, False
        self._crossing_s: float | None = None
        self._deepest_m = 0.0
        self._touched = False
        self._tilts = np.inf, -np.inf
        self._tall_m = extent_m(case)

    @property
    def lowest_m(self) -> float:
        """The lowest height of the centre, once all samples are added."""
        assert self.lowest is not None
        return float(self.lowest[0].position_m[0, 2])

    def add(self, part: DropSamples) -> tuple[Motion, list[int]]:
        """Add further samples.

        Returns
        -------
        The previous sample of each, and the samples at which the phase may change.
        """
        before = part.before()
        if self._last is not None:
            before = Motion.joined((self._last, part.at(slice(-1))))
        self.air.add(part, before)
        settled = self._settling.add(part)
        self.touchdowns.add(part, before)
        self._alter(part)
        self._look(part, before)
        self._tilt(part)
        self._pass(part, before)
        self._last = part.at(np.array([len(part) - 1]))  # no view of all
        steps = settled, self.air.contact_step, self.tumbled_step
        return before, [step for step in steps if step is not None]

    def phases(self) -> Phases:
        """Return when the body fell, touched the floor and came to rest, after the last sample."""
        return self._settling.phases(self.air.contact_step)

    @property
    def tumbles(self) -> bool:
        """True if a body that touches the floor tilted continues to turn."""
        low, high = self._tilts
        return high - low > FLAT_RAD

    def through_step(self) -> int | None:
        """Return the first sample at which the body is entirely below the floor.

        None if contact pushed the body back, or if the body fell beside the floor.
        """
        case = self.case
        returned = self.air.contact_step is not None and not _below(case, case.end)[0]
        return None if self.through is None or returned or self._beside else self.through[1]

    def impact(self, landing: Landing | None) -> Impact | None:
        """Return the impact on the floor, or None if there is none."""
        case, step = self.case, self.air.contact_step
        if step is None or self.lowest is None or (case.hides_contacts and not case.is_rigid):
            return None  # the first contact may not be reported
        lowest, lowest_step = self.lowest
        lowest_m = self.lowest_m
        crossing_s = penetration_m = None
        # With substeps the path between two samples is not straight, and may be deeper than both.
        floor_m = case.floor_height_m
        if floor_m is not None and case.is_rigid and not case.hides_contacts:
            crossing_s = self._crossing_s if case.starts_above and self._upright else None
            flat = turned_rad(case, lowest.orientation)[0] <= FLAT_RAD
            if case.over_floor(lowest.position_m) and flat:
                penetration_m = max(0.0, floor_m - lowest_m)
                if self._deepest_m > 1.01 * penetration_m + ROUGH_M:
                    penetration_m = None
        return Impact(
            time_free_fall_s=landing.time_free_fall_s if landing else None,
            time_damped_s=landing.time_damped_s if landing else None,
            time_simulated_s=crossing_s,
            step=step,
            speed_m_s=float(np.linalg.norm(self.arriving.velocity_m_s[0])),
            lowest_m=lowest_m,
            lowest_step=lowest_step,
            penetration_m=penetration_m,
        )

    def _alter(self, part: DropSamples) -> None:
        """Note the samples that differ from the release, for a scenario without steps."""
        if self.case.scenario.stepped:
            return
        state, start = _state(part), _state(self.case.start)
        rows = np.flatnonzero((state != start).any(axis=1))
        if len(rows):
            first, count = self.altered or [part.first + int(rows[0]), 0]
            self.altered = [first, count + len(rows)]

    def _look(self, part: DropSamples, before: Motion) -> None:
        """Note the height of the centre, and when the centre comes down to the floor."""
        case, heights_m = self.case, part.height_m
        low = int(np.argmin(heights_m))
        if self.lowest is None or heights_m[low] < self.lowest[0].position_m[0, 2]:
            self.lowest = part.at(np.array([low])), part.first + low
        self._deepest_m = max(
            self._deepest_m, -float(np.fmin.reduce(part.contact_distance_m, initial=0.0))
        )
        flew = self.air.airborne - part.first  # rows before the first contact
        if flew >= 0:
            fell = slice(flew + 1)
            self._upright &= not (turned_rad(case, part.orientation[fell]) > FLAT_RAD).any()
        if 0 < flew <= len(part):
            self.arriving = part.at(np.array([flew - 1]))
        elif flew == 0 and self._last is not None:
            self.arriving = self._last
        if self._crossing_s is None and case.floor_height_m is not None and flew > 0:
            row = crossing(before.position_m[:flew, 2], heights_m[:flew], case.floor_height_m)
            if row is not None:
                above_m, below_m = float(before.position_m[row, 2]), float(heights_m[row])
                share = (above_m - case.floor_height_m) / (above_m - below_m)
                self._crossing_s = (part.first + row - 1 + share) * case.timestep_s

    def _tilt(self, part: DropSamples) -> None:
        """Note the first tilted touch of the floor, and how far the body turns after it.

        If contacts may be unreported, all samples from the first contact on count as touching.
        """
        if not self.case.is_rigid:
            return
        touching, tilts = part.touching, tilt_rad(self.case, part.orientation)
        if self.case.hides_contacts:
            touching = np.logical_or.accumulate(touching) | self._touched
            self._touched = bool(touching[-1])
        row = 0
        if self.tumbled_step is None:
            tumbling = np.flatnonzero(touching & (tilts > FLAT_RAD))
            if not len(tumbling):
                return
            row = int(tumbling[0])
            self.tumbled_step = part.first + row
        low, high = self._tilts
        self._tilts = min(low, float(tilts[row:].min())), max(high, float(tilts[row:].max()))

    def _pass(self, part: DropSamples, before: Motion) -> None:
        """Note the first sample entirely below the floor; PyBullet's floor is 10 m thick.

        In other engines, only the floor's surface is known.
        """
        case, row = self.case, 0
        if not (case.scenario.floor and case.starts_above):
            return
        if self.through is None:
            untouched = np.flatnonzero(_below(case, part)[: max(self.air.airborne - part.first, 0)])
            row = int(untouched[0]) if len(untouched) else len(part)
            if len(untouched):
                self.through = before.at(np.array([row])), part.first + row
            if case.floor_height_m is not None:
                inside = part.height_m[:row] < case.floor_height_m - 1e-6
                if not case.is_bullet and self._tall_m is not None:
                    inside &= part.height_m[:row] > case.floor_height_m - self._tall_m
                self.overlapped |= bool(inside.any())
        if self.through is not None and not case.over_floor(part.position_m[row:]):
            self._beside = True


def _state(motion: Motion) -> Float64:
    return np.hstack(
        (motion.position_m, motion.orientation, motion.velocity_m_s, motion.spin_rad_s)
    )


def _below(case: DropCase, part: DropSamples) -> Flags:
    return np.asarray(part.height_m + case.engine.reach_m < 0)


def crossing(above_m: Float64, below_m: Float64, floor_height_m: float) -> int | None:
    """Return the first row in which a centre falls through a height; None if none does.

    Between two samples Bullet moves the body with one velocity, so the straight line between them
    is the simulation's own path, not an interpolation.
    """
    rows = np.flatnonzero((above_m > floor_height_m) & ~(below_m > floor_height_m))
    return int(rows[0]) if len(rows) else None

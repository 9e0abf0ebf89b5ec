"""Compares a recorded fall with the free-flight formula, before the first contact."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags
from drop_physics.drop.case import DropCase
from drop_physics.drop.results import Coverage
from drop_physics.drop.samples import DropSamples
from drop_physics.explain.segments import FLIGHT, segments_of
from drop_physics.fields import counted
from drop_physics.messages import Message
from drop_physics.physics.base import Motion


class Air:
    """The samples before the first contact, compared with the free-flight formula."""

    def __init__(self, case: DropCase) -> None:
        self._case = case
        self._follows = case.is_rigid and case.scenario.stepped
        self.contact_step: int | None = None
        """The first sample that touches the floor, or that a contact has acted on."""
        self.departs = 0 if self._follows and not case.released else None
        """The first sample that follows neither from the release nor from the law; None if all
        follow.
        """
        self.clamped_step: int | None = None
        """The first sample with a velocity clamped to ±100 m/s or rad/s."""
        self.landed_step: int | None = None
        """The first sample at which free fall has reached the floor."""

    @property
    def airborne(self) -> int:
        """Number of samples before the first contact."""
        return self._case.samples if self.contact_step is None else self.contact_step

    @property
    def covered(self) -> int:
        """Number of samples in free flight, according to the recording and to theory."""
        if not self._follows:
            return 0
        return min(step for step, _ in self._ends())

    def add(self, part: DropSamples, before: Motion) -> None:
        """Add samples; `before` is the previous sample of each (of the very first, itself)."""
        flew = self.contact_step is None
        touching = np.flatnonzero(part.touching)
        if flew and len(touching):
            self.contact_step = part.first + int(touching[0])
        in_air = min(len(part), self.airborne - part.first) if flew else 0
        if self._follows and self.departs is None and in_air:
            self._follow(part, before, in_air)
        floor_m = self._case.floor_height_m
        if floor_m is not None and self.landed_step is None:
            heights_m = self._case.free_fall_m(part.times_s(self._case.timestep_s))
            self.landed_step = _first(heights_m <= floor_m, part.first)

    def _follow(self, part: DropSamples, before: Motion, rows: int) -> None:
        """Compare the first rows, which are free of contact, with the free-flight formula."""
        case, touches = self._case, part.touches
        points = slice(int(np.searchsorted(touches.step, rows)))
        found = segments_of(
            part.at(slice(rows)),
            case.law,
            touches.at(points),
            exact=case.exact,
            before=before.at(slice(rows)),
            placed=part.steps[:rows] == 0,
        )
        stepped = part.steps[:rows] > 0
        departs = _first((found.code != FLIGHT) & stepped, part.first)
        followed = stepped if departs is None else stepped & (part.steps[:rows] < departs)
        if self.clamped_step is None:
            self.clamped_step = _first(found.held & followed, part.first)
        if departs is None:
            return
        if case.scenario.floor and self._touched(part, before, departs - part.first):
            self.contact_step = departs
        else:
            self.departs = departs

    def _touched(self, part: DropSamples, before: Motion, row: int) -> bool:
        """Return whether a contact acted that the engine did not report.

        A body near the floor that deviates from the law has touched the floor.
        """
        case = self._case
        if not case.hides_contacts:
            return False
        way_m = np.abs(before.velocity_m_s[row]).max() * case.timestep_s
        lowest_m = min(before.position_m[row, 2], part.position_m[row, 2])
        return bool(lowest_m <= case.engine.reach_m + way_m)

    def coverage(self) -> Coverage:
        """Return which samples the free-flight formula covers, and why it ends there.

        Call this after the last sample.
        """
        case, of = self._case, self._case.samples
        if not case.scenario.stepped:
            return Coverage(0, of, Message("no step was taken, so no law of motion applies"))
        if not case.is_rigid:
            why = Message(
                "the body has {joints}, and the law is that of one rigid body",
                joints=counted(case.engine.joints, "joint"),
            )
            return Coverage(0, of, why)
        samples, why = min(self._ends(), key=lambda end: end[0])
        if samples < of:
            why = Message("from sample {step} on {why}", step=samples, why=why)
        return Coverage(samples, of, why)

    def _ends(self) -> list[tuple[int, Message]]:
        """Return the known reasons why the coverage ends, each with its sample."""
        case = self._case
        departed = Message("the state does not follow {engine}'s law", engine=case.engine_name)
        ends = [
            (case.samples, Message("the whole recording is in free flight")),
            (self.departs, departed),
            (self.clamped_step, Message("a velocity is clamped to Bullet's limit of 100")),
            (self.landed_step, Message("free fall has reached the floor, where theory ends")),
            (self.contact_step, Message("the body is, or has been, in contact")),
        ]
        return [(step, why) for step, why in ends if step is not None]


def _first(held: Flags, first: int) -> int | None:
    """Return the index of the first flagged sample; None if there is none."""
    rows = np.flatnonzero(held)
    return first + int(rows[0]) if len(rows) else None

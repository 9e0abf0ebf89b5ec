"""How far the recorded fall follows the law of free flight, before anything touches the body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drop_physics.analysis.drop.case import Case
from drop_physics.analysis.drop.phases import Phases
from drop_physics.analysis.drop.results import Coverage
from drop_physics.analysis.explained.segments import FLIGHT, Segments, segments_of
from drop_physics.fields import counted
from drop_physics.messages import Message
from drop_physics.scenario import Engine

UNBALANCED: tuple[Engine, ...] = ("drake", "physx")
"""Engines whose bodies depart from the law at contact points that exert nothing."""


@dataclass(frozen=True)
class Air:
    """The samples before the first contact, under the law of one rigid body."""

    case: Case
    phases: Phases

    @cached_property
    def _segments(self) -> Segments:
        case, samples = self.case, max(1, self.phases.airborne)
        touches = case.touches
        points = slice(int(np.searchsorted(touches.step, samples)))
        motion = case.samples.at(slice(samples))
        return segments_of(
            motion, case.law, touches.at(points, touches.step[points]), exact=case.exact
        )

    @cached_property
    def departs(self) -> int | None:
        """The first sample to which neither the release nor the law leads; None if all follow."""
        if not self.case.is_rigid or not self.case.scenario.stepped:
            return None
        if not self.case.released:
            return 0
        off = np.flatnonzero(self._segments.code[1:] != FLIGHT)
        return int(off[0]) + 1 if len(off) else None

    @cached_property
    def clamped_step(self) -> int | None:
        """The first sample that was clamped to ±100 m/s or rad/s."""
        if not self.case.is_rigid or not self.case.scenario.stepped:
            return None
        held = np.flatnonzero(self._segments.held[1 : self.departs])
        return int(held[0]) + 1 if len(held) else None

    @property
    def is_lawless(self) -> bool:
        """Whether no law of the step is known to the sample that departs."""
        step = self.departs
        return step is not None and not self.case.law.covers(self.case.samples.before())[step]

    @property
    def touched_step(self) -> int | None:
        """The sample at which a contact acted that the engine does not report, or None.

        A body that departs from the law within reach of the floor has touched it.
        """
        case, step = self.case, self.departs
        if not step or self.is_lawless or not case.scenario.floor:
            return None
        if case.scenario.engine in UNBALANCED and case.samples.contact_points[step]:
            return step
        if not case.hides_contacts:
            return None
        way_m = np.abs(case.samples.velocity_m_s[step - 1]).max() * case.timestep_s
        lowest_m = float(case.samples.height_m[step - 1 : step + 1].min())
        return step if lowest_m <= case.engine.reach_m + way_m else None


def coverage_of(air: Air) -> Coverage:
    """Say which samples are broken down: those in free flight, by the law and in theory."""
    case, phases = air.case, air.phases
    of = phases.samples
    if not case.scenario.stepped:
        return Coverage(0, of, Message("no step was taken, so no law of motion applies"))
    if not case.is_rigid:
        why = Message(
            "the body has {joints}, and the law is that of one rigid body",
            joints=counted(case.engine.joints, "joint"),
        )
        return Coverage(0, of, why)
    ends = [(of, Message("the whole recording is in free flight"))]
    if air.departs is not None:
        why = Message("the state does not follow {engine}'s law", engine=case.engine_name)
        if air.is_lawless:
            why = Message(
                "no law of a step is known for {engine}'s {integrator} integration of spin or "
                "damping",
                engine=case.engine_name,
                integrator=case.scenario.effective_integrator,
            )
        ends.append((air.departs, why))
    if air.clamped_step is not None:
        clamped = Message("a velocity is clamped to Bullet's limit of 100")
        ends.append((air.clamped_step, clamped))
    if case.floor_height_m is not None:
        heights_m = case.free_fall_m(case.time_s[: phases.airborne + 1])
        landed = np.flatnonzero(heights_m <= case.floor_height_m)
        fallen = Message("free fall has reached the floor, where theory ends")
        ends += [(step, fallen) for step in landed[:1].tolist()]
    ends.append((phases.airborne, Message("the body is, or has been, in contact")))
    samples, why = min(ends, key=lambda end: end[0])
    if samples < of:
        why = Message("from sample {step} on {why}", step=samples, why=why)
    return Coverage(samples, of, why)

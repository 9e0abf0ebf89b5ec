"""How far the recorded state follows the law of the engine that the recording names."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.analysis.drop.case import Case
from pipeline.analysis.drop.phases import Phases
from pipeline.analysis.drop.results import Coverage


@dataclass(frozen=True)
class Mismatch:
    """The first sample in the air that does not follow Bullet's law."""

    step: int
    deviation: float
    """By how much, in the worst of its numbers [m, m/s or rad/s]."""


def find_mismatch(case: Case, found: Phases) -> Mismatch | None:
    """Return the first sample in the air that does not follow Bullet's law, and by how much.

    The release is in the air, whatever is recorded of contact.
    """
    step = case.segments.first_unexplained
    in_air = max(1, found.airborne) if case.scenario.stepped else found.samples
    if not case.is_rigid or step is None or step >= in_air:
        return None
    return Mismatch(step, float(case.segments.deviation[step]))


def clamped_step(case: Case, found: Phases) -> int | None:
    """Return the first sample in the air that the limit of ±100 m/s or rad/s acted on, or None."""
    if not case.is_rigid or not case.scenario.stepped:
        return None
    held = np.flatnonzero(case.law.limited(case.samples.at(slice(max(0, found.airborne - 1)))))
    return int(held[0]) + 1 if len(held) else None


def unseen_contact(case: Case, mismatch: Mismatch | None) -> int | None:
    """Return the sample at which a contact acted that PyBullet does not report, or None.

    Of several substeps it reports the contact of the last one only. What leaves the law within
    reach of the floor has met it.
    """
    if mismatch is None or case.substeps == 1 or not case.scenario.floor:
        return None
    around_m = case.samples.position_m[max(mismatch.step - 1, 0) : mismatch.step + 1]
    way_m = np.abs(case.samples.velocity_m_s[max(mismatch.step - 1, 0)]).max() * case.timestep_s
    within = float(around_m[:, 2].min()) <= case.engine.reach_m + way_m
    return mismatch.step if within else None


def joints_of(count: int) -> str:
    """Return a number of joints in words."""
    return "1 joint" if count == 1 else f"{count} joints"


def coverage_of(
    case: Case, found: Phases, mismatch: Mismatch | None, clamped: int | None
) -> Coverage:
    """Say which samples are taken apart: those in free flight, by the law and in theory."""
    of = found.samples
    if not case.scenario.stepped:
        return Coverage(0, of, "no step was taken, so no law of motion applies")
    if not case.is_rigid:
        why = f"the body has {joints_of(case.engine.joints)}, and the law is that of one rigid body"
        return Coverage(0, of, why)
    ends: list[tuple[int, str]] = [(of, "the whole recording is in free flight")]
    if mismatch is not None:
        ends.append((mismatch.step, "the state does not follow Bullet's law"))
    if clamped is not None:
        ends.append((clamped, "a velocity is held at Bullet's limit of 100"))
    ends.append((case.lands_at, "free fall has reached the floor, and there is no theory"))
    ends.append((found.airborne, "the body is, or has been, in contact"))
    samples, why = min(ends, key=lambda end: end[0])
    return Coverage(samples, of, why if samples == of else f"from sample {samples} on {why}")

"""How far the recorded state follows the law of the engine that the recording names."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.analysis.drop.case import Case
from pipeline.analysis.drop.phases import Phases
from pipeline.analysis.drop.results import Coverage
from pipeline.laws import bullet_air
from pipeline.laws.flight import Flight, is_turned, law_path


@dataclass(frozen=True)
class Mismatch:
    """The first sample in the air that does not follow Bullet's law."""

    step: int
    deviation: float
    """By how much, in the worst of its numbers [m, m/s or rad/s]."""


def law_of_flight(case: Case, found: Phases) -> Flight | None:
    """Return the path of Bullet's law until the first contact; None where it covers nothing.

    The release is in the air, whatever is recorded of contact.
    """
    if not case.scenario.stepped or not case.is_rigid:
        return None
    return law_path(case.scenario, case.engine, max(1, found.airborne) - 1)


def find_mismatch(case: Case, flight: Flight | None) -> Mismatch | None:
    """Return the first sample in the air that does not follow Bullet's law, and by how much."""
    samples = case.samples
    if not case.scenario.stepped:
        state = np.hstack((samples.position_m, samples.orientation, samples.velocity_m_s))
        deviation = np.abs(state - state[0]).max(axis=1)
        return _first(deviation, deviation > 0)
    if flight is None:
        return None
    steps = len(flight.position_m)
    recorded = (samples.position_m, samples.velocity_m_s, samples.spin_rad_s, samples.orientation)
    # A quaternion and its negative are the same orientation.
    agree = np.sum(flight.orientation_xyzw * samples.orientation[:steps], axis=1, keepdims=True)
    turned = np.where(agree < 0, -flight.orientation_xyzw, flight.orientation_xyzw)
    law = np.hstack((flight.position_m, flight.velocity_m_s, flight.spin_rad_s, turned))
    deviation = np.abs(np.hstack([part[:steps] for part in recorded]) - law).max(axis=1)
    # Spin goes through sin and cos, which differ between C libraries, and tumbling amplifies that.
    exact = case.engine.machine in bullet_air.EXACT_MACHINES
    tolerance = 1e-9 if is_turned(case.scenario) else 0.0 if exact else bullet_air.FUSED
    allowed = tolerance * np.maximum(1.0, np.abs(law).max(axis=1))
    return _first(deviation, ~(deviation <= allowed))


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


def _first(deviation: np.ndarray, off: np.ndarray) -> Mismatch | None:
    steps = np.flatnonzero(off)
    return Mismatch(int(steps[0]), float(deviation[steps[0]])) if len(steps) else None


def joints_of(count: int) -> str:
    """Return a number of joints in words."""
    return "1 joint" if count == 1 else f"{count} joints"


def coverage_of(
    case: Case, found: Phases, flight: Flight | None, mismatch: Mismatch | None
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
    if flight is not None and flight.clamped is not None:
        ends.append((flight.clamped, "a velocity is held at Bullet's limit of 100"))
    ends.append((case.lands_at, "free fall has reached the floor, and there is no theory"))
    ends.append((found.airborne, "the body is, or has been, in contact"))
    samples, why = min(ends, key=lambda end: end[0])
    return Coverage(samples, of, why if samples == of else f"from sample {samples} on {why}")

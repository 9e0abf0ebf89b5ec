"""Impact, contact, bounces and rest: what was recorded beside what Bullet's law predicts.

Any body is measured; causes are given only where the contact law covers it: see `covers`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.drop.case import Case
from drop_physics.analysis.drop.phases import Phases, crossing_time, touching
from drop_physics.analysis.drop.posture import (
    FLAT_RAD,
    face_up,
    flat_height_m,
    stands,
    tilt_rad,
    turned_rad,
)
from drop_physics.analysis.drop.results import Bounce, Contact, Impact, Landing, Rest, RestTerms
from drop_physics.laws import bullet_contact, mujoco_contact, theory
from drop_physics.laws.bullet import BulletLaw
from drop_physics.laws.bullet_contact import CONTACT_ERP, CONTACT_SLOP_M, RESTITUTION_THRESHOLD_M_S

Float64 = NDArray[np.float64]

LONGEST_THROW_S = 3600.0
CORNERS = 4
"""Contact points of a box that lies flat."""
REPRODUCED = 1e-3
"""Share of the approach by which a rebound may deviate from the contact law and still be explained:
ten times the largest effect of the solver's early stop that was measured."""
ROUNDED = 1e-9
"""Share of the approach by which two ways to compute a rebound may differ."""
AT_REST_M_S = 1e-4
"""A predicted path slower than this has come to rest."""
ROUGH_M = 1e-6
"""By how much a contact point may be deeper than the centre shows."""
SUNK_M = 1e-9
"""How far a body at rest may be from a closed form of its contact to be explained by it."""


# -- when it lands --------------------------------------------------------------------------------


def find_landing(case: Case) -> Landing | None:
    """Return when the body reaches the floor by theory; None where it never does.

    Only for a body that meets the floor as it was released: one without spin, or a ball.
    """
    floor_m, fall = case.floor_height_m, case.fall
    turns = any(case.scenario.spin_rad_s) and not case.is_ball
    if floor_m is None or turns or not case.is_rigid or not case.scenario.stepped:
        return None
    free_s = theory.impact_time_free(fall, floor_m)
    if not case.starts_above or free_s is None:
        return None
    # An oblique throw is integrated, which is useless over days: thrown up in almost no gravity.
    oblique = fall.drag.quadratic_per_m > 0 and any(fall.velocity_m_s[:2])
    endless = oblique and free_s > LONGEST_THROW_S
    damped_s = None if endless else theory.impact_time_damped(fall, floor_m)
    # Drag takes no body further sideways than free fall.
    reach_m = np.array(fall.velocity_m_s) * free_s
    if not case.over_floor(reach_m[None]):
        return None
    return Landing(time_free_fall_s=free_s, time_damped_s=damped_s)


def find_impact(case: Case, phases: Phases, landing: Landing | None) -> Impact | None:
    """Return the impact on the floor, or None if there is none."""
    if phases.contact_step is None or (case.hides_contacts and not case.is_rigid):
        return None  # the first contact may not be reported
    samples, floor_m = case.samples, case.floor_height_m
    height_m = samples.height_m
    lowest = int(np.argmin(height_m))
    before = max(phases.contact_step - 1, 0)
    crossing_s = penetration_m = None
    if floor_m is not None and case.is_rigid:
        # With substeps the path between two samples is not straight, and may be deeper than both.
        fell = slice(phases.contact_step + 1)
        upright = not (turned_rad(case, fell) > FLAT_RAD).any()
        if case.starts_above and not case.hides_contacts and upright:
            crossing_s = crossing_time(height_m[: phases.contact_step], floor_m, case.timestep_s)
        there = slice(lowest, lowest + 1)
        flat = turned_rad(case, there)[0] <= FLAT_RAD
        if case.over_floor(samples.position_m[there]) and not case.hides_contacts and flat:
            penetration_m = max(0.0, floor_m - float(height_m[lowest]))
            if _deepest_point_m(case) > 1.01 * penetration_m + ROUGH_M:
                penetration_m = None
    return Impact(
        time_free_fall_s=landing.time_free_fall_s if landing else None,
        time_damped_s=landing.time_damped_s if landing else None,
        time_simulated_s=crossing_s,
        step=phases.contact_step,
        speed_m_s=float(np.linalg.norm(samples.velocity_m_s[before])),
        lowest_m=float(height_m[lowest]),
        lowest_step=lowest,
        penetration_m=penetration_m,
    )


def _deepest_point_m(case: Case) -> float:
    """Return how deep a point of contact was in the floor [m], at most."""
    return -float(np.fmin.reduce(case.samples.contact_distance_m, initial=0.0))


# -- the contact law ------------------------------------------------------------------------------


def covers(case: Case) -> bool:
    """Whether the contact law covers this drop: one box that lands flat and stays flat.

    It is released flat, above the floor, without spin or sideways velocity, with its centre of mass
    above its base, and contact is not a spring.
    """
    sideways = any((*case.scenario.velocity_m_s[:2], *case.scenario.spin_rad_s))
    floor_m = case.floor_height_m
    return (
        isinstance(case.law, BulletLaw)
        and case.is_box
        and not case.is_springy
        and case.scenario.stepped
        and floor_m is not None
        and case.engine.pair_restitution is not None
        and not sideways
        and float(tilt_rad(case, slice(1))[0]) < 1e-9
        and stands(case)
        and case.starts_above
    )


@dataclass(frozen=True)
class Path:
    """Heights [m] and vertical velocities [m/s] of the contact law, shape (samples,) each."""

    height_m: Float64
    velocity_m_s: Float64


def law_path(case: Case, *, contact_erp: float | None = None) -> Path | None:
    """Return the path by the contact law from the release on, or None where it does not apply.

    `contact_erp` replaces the scenario's.
    """
    if not covers(case):
        return None
    fall, steps = case.fall, len(case.samples.height_m) - 1
    path = _law(case, fall.height_m, fall.velocity_m_s[2], steps, contact_erp=contact_erp)
    return path if float(path.height_m.min()) > _deepest_m(case) else None


def _law(
    case: Case,
    height_m: float,
    velocity_m_s: float,
    steps: int,
    *,
    contact_erp: float | None = None,
) -> Path:
    assert isinstance(case.law, BulletLaw)
    assert case.floor_height_m is not None
    assert case.engine.pair_restitution is not None
    return Path(
        *bullet_contact.flat_drop(
            case.law,
            height_m=height_m,
            velocity_m_s=velocity_m_s,
            steps=steps,
            rest_height_m=case.floor_height_m,
            restitution=case.engine.pair_restitution,
            contact_erp=_contact_erp(case) if contact_erp is None else contact_erp,
            restitution_threshold_m_s=restitution_threshold_m_s(case),
        )
    )


def _deepest_m(case: Case) -> float:
    """Return how low the centre may get [m]: from half-way down the floor pushes it out below."""
    return (case.floor_height_m or 0.0) - bullet_contact.FLOOR_HALF_THICKNESS_M


def _contact_erp(case: Case) -> float:
    asked = case.scenario.contact_erp
    return CONTACT_ERP if asked is None else asked


def restitution_threshold_m_s(case: Case) -> float:
    """Return the speed below which no body bounces [m/s]."""
    asked = case.scenario.restitution_threshold_m_s
    return RESTITUTION_THRESHOLD_M_S if asked is None else asked


def find_contact(
    case: Case, phases: Phases, tumbled_step: int | None, law: Path | None
) -> Contact | None:
    """Return how far the recorded heights deviate from the contact law while the body is flat."""
    if law is None or phases.contact_step is None or tumbled_step == phases.contact_step:
        return None
    deviation_m = case.samples.height_m[:tumbled_step] - law.height_m[:tumbled_step]
    worst = int(np.argmax(np.abs(deviation_m, out=deviation_m)))
    return Contact(float(deviation_m[worst]), worst)


# -- bounces --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Episode:
    """A run of samples that touch the floor, between two flights or at an end of the recording."""

    first: int
    last: int
    pushed: int
    """The last of them at which contact pushed."""
    approach_m_s: float
    """Downward speed that the contact met."""
    leaves: bool
    """Whether the body rises from it before the recording ends."""


def episodes(case: Case) -> Iterator[Episode]:
    """Yield the contacts with the floor that begin in the air, in order.

    None with substeps: PyBullet reports only the contacts of the last one.
    """
    if case.hides_contacts:
        return
    touches = touching(case.samples)
    edges = np.diff(np.concatenate(([False], touches, [False])).astype(np.int8))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    velocity_m_s = case.samples.velocity_m_s[:, 2]
    for first, end in zip(starts.tolist(), ends.tolist(), strict=True):
        approach_m_s = _approach_m_s(case, first - 1)
        if approach_m_s <= 0 or (first <= 1 and not case.starts_above):
            continue  # it was in the floor already
        leaves = end < len(touches) and velocity_m_s[end - 1] > 0
        pushed = np.flatnonzero(case.samples.pushed[first:end])
        if len(pushed):
            yield Episode(first, end - 1, first + int(pushed[-1]), approach_m_s, bool(leaves))


def _approach_m_s(case: Case, step: int) -> float:
    """Return the downward speed that the contact after a sample meets [m/s].

    Restitution acts on the velocity that the step would lead to without a contact.
    """
    if isinstance(case.law, BulletLaw):
        return -bullet_contact.free_velocity(case.law, case.samples.velocity_m_s[step])
    return -float(case.law.free_velocities(case.samples.velocity_m_s[step : step + 1])[0, 2])


def find_bounces(case: Case, tumbled_step: int | None) -> list[Bounce]:
    """Return the rebounds that leave the floor, beside what restitution alone would give."""
    floor_m = case.floor_height_m
    if not case.is_rigid or floor_m is None or case.fall.gravity_m_s2 >= 0:
        return []
    leaving = [episode for episode in episodes(case) if episode.leaves]
    touches, height_m = touching(case.samples), case.samples.height_m
    following = np.append(np.flatnonzero(touches), len(touches))
    law = law_path(case, contact_erp=0.0) if leaving else None
    uncorrected_m = [] if law is None else _apexes(law.height_m, floor_m)
    bounces = []
    plain = True
    for number, episode in enumerate(leaving, start=1):
        plain = plain and _is_plain(case, episode, tumbled_step)
        next_touch = int(following[np.searchsorted(following, episode.last + 1)])
        # Where the recording ends on the way up, there is no apex to compare.
        whole = plain and (next_touch < len(touches) or case.samples.velocity_m_s[-1, 2] <= 0)
        rebound_m_s = float(case.samples.velocity_m_s[episode.pushed, 2])
        bounces.append(
            Bounce(
                step=episode.first - 1,
                approach_m_s=episode.approach_m_s,
                rebound_m_s=rebound_m_s,
                effective_restitution=rebound_m_s / episode.approach_m_s if plain else None,
                apex_m=float(height_m[episode.last : next_touch].max()) - floor_m,
                predicted_apex_m=_predicted_apex_m(case, number) if whole else None,
                uncorrected_apex_m=uncorrected_m[number - 1]
                if whole and number <= len(uncorrected_m)
                else None,
                correction_m_s=_correction_m_s(case, episode) if plain else None,
            )
        )
    return bounces


def _is_plain(case: Case, episode: Episode, tumbled_step: int | None) -> bool:
    """Whether a rebound is by restitution alone: of a ball, or of a box on all four corners."""
    if case.is_springy or (tumbled_step is not None and episode.last >= tumbled_step):
        return False
    points = case.samples.contact_points[episode.first : episode.last + 1]
    return case.is_ball or (case.is_box and bool((points == CORNERS).all()))


def _predicted_apex_m(case: Case, number: int) -> float | None:
    """Return e^(2k) h for the k-th bounce [m]; a throw arrives like a drop from v²/2g higher."""
    if case.engine.pair_restitution is None or case.floor_height_m is None:
        return None
    fall = case.fall
    thrown_m = fall.velocity_m_s[2] ** 2 / (-2 * fall.gravity_m_s2)
    drop_m = fall.height_m - case.floor_height_m + thrown_m
    return float(bullet_contact.rebound_heights(drop_m, case.engine.pair_restitution, number)[-1])


def _apexes(height_m: Float64, floor_m: float) -> list[float]:
    """Return the highest point above the floor after each time that a path leaves it [m]."""
    below = np.concatenate(([False], height_m <= floor_m, [False]))
    starts, ends = np.flatnonzero(np.diff(below.astype(np.int8))).reshape(-1, 2).T
    following = np.append(starts, len(height_m))[1:]
    return [
        float(height_m[end:start].max()) - floor_m
        for end, start in zip(ends.tolist(), following.tolist(), strict=True)
        if end < len(height_m)
        # The recording may end on the way up.
        and (start < len(height_m) or height_m[end:start].argmax() < start - end - 1)
    ]


def _correction_m_s(case: Case, episode: Episode) -> float | None:
    """Return what the position correction adds to restitution × approach [m/s].

    By the contact law, started from the recorded sample before the episode. None where contact
    pushes for more than one step, the law does not reproduce the recorded rebound, or without a
    position correction its rebound is not restitution × approach: a body that is not yet in the
    floor by the slop is slowed by the rest of the slop.
    """
    before, samples = episode.first - 1, case.samples
    if not covers(case) or samples.height_m[before] <= _deepest_m(case):
        return None
    if episode.pushed > episode.first:
        return None
    height_m, velocity_m_s = samples.height_m[before], samples.velocity_m_s[before, 2]
    start, steps = (float(height_m), float(velocity_m_s)), episode.pushed - before
    rebound_m_s = float(_law(case, *start, steps).velocity_m_s[-1])
    plain_m_s = float(_law(case, *start, steps, contact_erp=0.0).velocity_m_s[-1])
    recorded_m_s = float(samples.velocity_m_s[episode.pushed, 2])
    if abs(recorded_m_s - rebound_m_s) > REPRODUCED * episode.approach_m_s:
        return None
    asked_m_s = bullet_contact.rebound_speed(
        -episode.approach_m_s,
        case.engine.pair_restitution or 0.0,
        threshold_m_s=restitution_threshold_m_s(case),
    )
    if abs(plain_m_s - asked_m_s) > ROUNDED * episode.approach_m_s:
        return None
    return rebound_m_s - asked_m_s


# -- rest -----------------------------------------------------------------------------------------


def find_rest(
    case: Case, phases: Phases, tumbled_step: int | None, law: Path | None
) -> Rest | None:
    """Return where the body comes to lie, and why that is not exactly the rest height."""
    if not phases.lies:
        return None
    last_m = float(case.samples.height_m[-1])
    expected_m = flat_height_m(case, len(case.samples.height_m) - 1)
    if expected_m is None:
        return Rest(last_m, None, None, phases.rest_step, None)
    terms = None
    if law is not None and tumbled_step is None:
        terms = _rest_terms(case, law, last_m, expected_m)
    error_m = last_m - expected_m
    return Rest(last_m, expected_m, error_m, phases.rest_step, terms, _sinks_m(case, error_m))


def _rest_terms(case: Case, law: Path, last_m: float, expected_m: float) -> RestTerms | None:
    """Return why the body lies where it does; None where the law does not come to rest."""
    settles = abs(law.velocity_m_s[-10:]).max() < AT_REST_M_S
    if not settles or _bounces_on(case) or not _contact_erp(case) > 0:
        return None
    law_end_m = float(law.height_m[-1])
    return RestTerms(
        slop=-CONTACT_SLOP_M,
        solver=last_m - law_end_m,
        settling=law_end_m - (expected_m - CONTACT_SLOP_M),
    )


def _sinks_m(case: Case, error_m: float) -> float | None:
    """Return how deep a body at rest sinks into soft contact [m]; None where it lies elsewhere."""
    engine, gravity_m_s2 = case.engine, -case.fall.gravity_m_s2
    points, depth_m = int(case.samples.contact_points[-1]), None
    if gravity_m_s2 > 0 and points and engine.solref is not None and engine.solimp is not None:
        time_constant_s, ratio = engine.solref
        if time_constant_s > 0:
            time_constant_s = max(time_constant_s, mujoco_contact.shortest_s(case.timestep_s))
        depth_m = mujoco_contact.rest_depth_m(
            gravity_m_s2, points, (time_constant_s, ratio), engine.solimp
        )
    if gravity_m_s2 > 0 and engine.modulus_pa is not None and case.is_box:
        axis, _ = face_up(case, len(case.samples) - 1)
        edges_m = np.array(engine.shape_dimensions_m)
        area_m2 = float(np.prod(np.delete(edges_m, axis)))
        # The pressure grows from 0 at the faces to the modulus in the middle.
        stiffness_n_m = engine.modulus_pa * area_m2 / (edges_m[axis] / 2)
        depth_m = engine.mass_kg * gravity_m_s2 / float(stiffness_n_m)
    if depth_m is None or abs(error_m + depth_m) > SUNK_M:
        return None
    return depth_m


def _bounces_on(case: Case) -> bool:
    """Whether restitution acts on the velocity that gravity gives a body at rest in a step.

    Then it comes to rest above the slop, where each bounce just makes up for the step.
    """
    assert isinstance(case.law, BulletLaw)
    falls_m_s = bullet_contact.free_velocity(case.law, (0.0, 0.0, 0.0))
    threshold_m_s = restitution_threshold_m_s(case)
    restitution = case.engine.pair_restitution or 0.0
    return bullet_contact.rebound_speed(falls_m_s, restitution, threshold_m_s=threshold_m_s) != 0

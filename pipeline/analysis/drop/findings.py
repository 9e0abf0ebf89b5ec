"""What a recording gives away: the mistakes and surprises that people ask about.

Each finding says what was seen, with the number, why it is so, and the one call or option that
changes it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.analysis.drop.case import FLOOR_REACH_M, TOUCHING_M, Case
from pipeline.analysis.drop.convergence import cancelling_timestep
from pipeline.analysis.drop.landing import CORNERS, Path, episodes, restitution_threshold_m_s
from pipeline.analysis.drop.mismatch import Mismatch, joints_of
from pipeline.analysis.drop.phases import Phases
from pipeline.analysis.drop.posture import FLAT_RAD, extent_m, tilt_rad, tumbles
from pipeline.analysis.drop.results import Bounce, Finding, Impact, Landing, Moment, Rest
from pipeline.fields import counted, decimals

DEEP_PENETRATION = 0.1
"""Share of the body's height that it may sink into the floor before it is worth reporting."""
REST_BELOW_M = 1e-6
"""A body that lies lower than this below its rest height is worth reporting."""
ENOUGH_ITERATIONS = 50
"""What Bullet's solver has by default: there it is the residual that stops it."""
SOLVER_M = 1e-8
"""What the solver's early stop leaves of a rest height, where it is worth reporting."""
INFLATED = 0.01
"""Relative excess of a rebound over the restitution asked for that is worth reporting."""
CANCELS = 0.01
"""Share of the damping's term that may be left where timestep and damping are said to cancel."""
SWALLOWED_M_S = 0.01
"""A rebound slower than this is no bounce that anybody misses."""


@dataclass(frozen=True)
class Evidence:
    """What the findings are drawn from: the case, and what the analysis made of it."""

    case: Case
    phases: Phases
    mismatch: Mismatch | None
    clamped_step: int | None
    """First sample at which a velocity is held at Bullet's limit."""
    moment: Moment | None
    """The sample that the analysis takes apart first."""
    landing: Landing | None
    impact: Impact | None
    tumbled_step: int | None
    bounces: list[Bounce]
    rest: Rest | None
    law: Path | None
    """The contact law's path, where it covers the drop."""


def findings(evidence: Evidence) -> list[Finding]:
    """Return what a recording gives away, the gravest first."""
    return [
        *_never_moved(evidence),
        *_joints(evidence),
        *_no_floor(evidence),
        *_tunnelled(evidence),
        *_law_mismatch(evidence),
        *_starts_in_contact(evidence),
        *_damping(evidence),
        *_velocity_clamped(evidence),
        *_refining_hurts(evidence),
        *_deep_penetration(evidence),
        *_tumbled(evidence),
        *_bounces(evidence),
        *_rest_below_expected(evidence),
        *_still_airborne(evidence),
    ]


def _never_moved(e: Evidence) -> Iterator[Finding]:
    heights_m, scenario = e.case.samples.height_m, e.case.scenario
    if not scenario.gravity_set:
        yield Finding(
            "no-gravity",
            f"the engine's gravity is 0 m/s² and the centre is at {decimals(heights_m[-1], 4)} m "
            "at the end: "
            + _call(e, "PyBullet starts without gravity; call p.setGravity(0, 0, -9.81), i.e. ")
            + "omit --no-gravity",
        )
    if not scenario.stepped and e.mismatch is None:
        yield Finding(
            "not-stepped",
            f"all {len(heights_m)} samples are the same to the last bit, at "
            f"{decimals(heights_m[0], 4)} m: "
            + _call(e, "time passes only in p.stepSimulation(); call it once per sample, i.e. ")
            + "omit --no-step",
        )


def _call(e: Evidence, words: str) -> str:
    """Return words that name a call of PyBullet; nothing where another engine dropped the body."""
    return words if e.case.is_bullet else ""


def _joints(e: Evidence) -> Iterator[Finding]:
    if not e.case.is_rigid:
        yield Finding(
            "joints-not-explained",
            f"the body has {joints_of(e.case.engine.joints)}: the laws here are those of one rigid "
            "body, so its motion and its contacts are recorded but not explained; drop a body of "
            "one link with --body",
        )


def _no_floor(e: Evidence) -> Iterator[Finding]:
    position_m, floor_m = e.case.samples.position_m, e.case.engine.rest_height_m
    lowest_m = float(position_m[:, 2].min())
    if floor_m is None or e.mismatch is not None:
        return
    if not e.case.scenario.floor and lowest_m < floor_m <= e.case.fall.height_m:
        yield Finding(
            "no-floor",
            f"the centre went down to {decimals(lowest_m, 4)} m without a contact: there is "
            "nothing to land on; "
            + _call(e, 'call p.loadURDF("plane.urdf"), i.e. ')
            + "omit --no-floor",
        )
    low = position_m[:, 2] + e.case.engine.reach_m < 0
    if e.case.scenario.floor and low.any() and not e.case.over_floor(position_m[low][:1]):
        yield Finding(
            "no-floor",
            f"the centre went down to {decimals(lowest_m, 4)} m past the floor's edge: plane.urdf "
            f"ends {FLOOR_REACH_M:g} m from the origin; throw less far with --velocity",
        )


def _tunnelled(e: Evidence) -> Iterator[Finding]:
    position_m = e.case.samples.position_m
    # As a whole, and it did not come back.
    through = e.case.starts_above and position_m[-1, 2] + e.case.engine.reach_m < 0
    below = np.flatnonzero(position_m[: e.phases.airborne, 2] + e.case.engine.reach_m < 0)
    if not (e.case.scenario.floor and through and len(below)):
        return
    if not e.case.over_floor(position_m[below[0] :]):
        return
    step = int(below[0])
    where = f"at {e.case.time_s[step]:.4g} s (step {step}) the body is below the floor, its centre "
    where += f"at {decimals(position_m[step, 2], 4)} m, and nothing has touched"
    if e.case.engine.shape == "none":
        reason = "the body has no collision shape; add a <collision> to the URDF of --body"
    elif _overlapped(e.case, step):
        reason = (
            "it has overlapped the floor, and no contact was found: its collision is switched off; "
            "look for a collision filter in the URDF of --body, or p.setCollisionFilterGroupMask"
        )
    else:
        moved_m = float(np.linalg.norm(position_m[step] - position_m[step - 1]))
        reason = (
            f"it moved {moved_m:.4g} m in a step, and contact is looked for between steps only; "
            f"shorten the step with {_call(e, 'p.setTimeStep, i.e. ')}--timestep"
        )
    yield Finding("tunnelled", f"{where}: {reason}")


def _overlapped(case: Case, step: int) -> bool:
    """Whether a step was made from within the floor before a sample; or none ever meets it."""
    floor_m = case.floor_height_m
    return floor_m is None or bool((case.samples.height_m[:step] < floor_m - 1e-6).any())


def _law_mismatch(e: Evidence) -> Iterator[Finding]:
    if e.mismatch is None:
        return
    step, deviation = e.mismatch.step, e.mismatch.deviation
    engine = e.case.engine
    which = f"pybullet {engine.pybullet_version or '?'}"
    if not e.case.is_bullet:
        which = f"{e.case.engine_name} {engine.engine_version or '?'}"
    made = f"what {which} makes of the samples before it"
    if not e.case.scenario.stepped:
        made = "the release, although no step was taken"
    yield Finding(
        "law-mismatch",
        f"sample {step} is {deviation:.2g} (m or m/s) away from {made}: the state was altered, or "
        "another engine made it; record it again with drop simulate",
    )


def _starts_in_contact(e: Evidence) -> Iterator[Finding]:
    floor_m, height_m = e.case.floor_height_m, e.case.fall.height_m
    if floor_m is None or e.case.starts_above:
        return
    deep = f"{(floor_m - height_m) * 1e3:.4g} mm inside the floor"
    touches = height_m > floor_m - TOUCHING_M
    yield Finding(
        "starts-in-contact",
        f"the body is released {'touching the floor' if touches else deep}: there is no "
        f"fall to compare with theory; release it above {floor_m:.6g} m with --height",
    )


def _damping(e: Evidence) -> Iterator[Finding]:
    told = e.case.scenario.linear_damping is not None
    if told or not e.case.scenario.stepped or not e.case.is_bullet:
        return
    if e.case.scenario.coordinates == "maximal":
        yield Finding(
            "no-damping-in-maximal-coordinates",
            "linear damping is 0: a btRigidBody (useMaximalCoordinates=True) has none by default, "
            "where a btMultiBody has 0.04; to have the same, set --linear-damping",
        )
    elif e.moment is not None and e.moment.terms_m is not None and e.moment.terms_m.damping:
        # What is gone without it: what it does to the timestep's share too.
        moves_m = e.moment.terms_m.damping + e.moment.terms_m.interaction
        yield Finding(
            "default-damping",
            f"damping moves the body by {decimals(moves_m * 1e3, 2, '+')} mm at "
            f"{e.moment.time_s:.4g} s: PyBullet damps every body with 0.04 by default; "
            "call p.changeDynamics(body, -1, linearDamping=0), i.e. --linear-damping 0",
        )


def _velocity_clamped(e: Evidence) -> Iterator[Finding]:
    if e.clamped_step is not None:
        state = e.case.samples
        fastest = np.abs(np.hstack((state.velocity_m_s, state.spin_rad_s))).max(axis=1)
        yield Finding(
            "velocity-clamped",
            f"a velocity reaches {fastest[e.clamped_step]:.6g} (m/s or rad/s) at "
            f"{e.case.time_s[e.clamped_step]:.4g} s and is held there: a btMultiBody keeps every "
            "component within ±100; use --coordinates maximal",
        )


def _refining_hurts(e: Evidence) -> Iterator[Finding]:
    if e.moment is None or e.moment.terms_m is None:
        return
    terms = e.moment.terms_m
    cancel_s = cancelling_timestep(
        e.case.timestep_s, timestep_m=terms.timestep, damping_m=terms.damping
    )
    if cancel_s is None or cancel_s > e.moment.time_s:
        return
    # The interaction shrinks with the timestep as well: what it leaves there is not cancelled.
    left_m = terms.interaction * cancel_s / e.case.timestep_s
    grows = abs(e.moment.error_m) < abs(terms.damping)
    if grows and abs(left_m) <= CANCELS * abs(terms.damping):
        yield Finding(
            "refining-hurts",
            f"at {e.moment.time_s:.4g} s the error is {decimals(e.moment.error_m * 1e3, 2, '+')} "
            f"mm and goes to {decimals(terms.damping * 1e3, 2, '+')} mm as the timestep shrinks: "
            f"the timestep's share and the damping's cancel at {_rate(cancel_s)} s; take the error "
            "apart before refining, or switch the damping off with --linear-damping 0",
        )


def _rate(timestep_s: float) -> str:
    """Write a timestep as people set it: 1/341, or 0.4 where that says it better."""
    return f"1/{1 / timestep_s:.0f}" if timestep_s < 0.1 else f"{timestep_s:.3g}"


def _deep_penetration(e: Evidence) -> Iterator[Finding]:
    tall_m = extent_m(e.case)
    if e.impact is None or e.impact.penetration_m is None or tall_m is None:
        return
    depth_m, released_above = e.impact.penetration_m, e.case.starts_above
    # The lowest point may be that of a later, harder landing: only the first has this speed.
    first = e.impact.lowest_step <= e.phases.airborne
    if released_above and first and depth_m > DEEP_PENETRATION * tall_m:
        per_step_m = abs(float(e.case.samples.velocity_m_s[e.phases.airborne - 1, 2]))
        per_step_m *= e.case.substep_s
        reason = (
            f"contact acts only once it is inside, and it moves {decimals(per_step_m * 1e3, 1)} mm "
            f"down in a step; shorten the step with {_call(e, 'p.setTimeStep, i.e. ')}--timestep"
        )
        soft = _soft(e.case) if e.case.scenario.engine == "mujoco" else None
        yield Finding(
            "deep-penetration",
            f"the body sinks {decimals(depth_m * 1e3, 1)} mm into the floor, "
            f"{depth_m / tall_m:.0%} of its height: "
            f"{_spring(e.case) or soft or reason}",
        )


def _spring(case: Case) -> str | None:
    """Say why contact gives way, where the body asks for that."""
    if not case.is_springy:
        return None
    return (
        f"the body's URDF asks for a contact that gives way like a spring, of "
        f"{case.engine.contact_stiffness_n_m:g} N/m; omit <stiffness> and <damping> from its "
        "<contact>, or set them with p.changeDynamics"
    )


def _soft(case: Case) -> str | None:
    """Say why contact gives way where a shorter timestep does not help."""
    if case.engine.modulus_pa is not None:
        return (
            f"Drake's contact is compliant, with a modulus of {case.engine.modulus_pa:.0e} Pa; a "
            "larger one among the proximity properties of the shape makes it stiffer"
        )
    if case.engine.solref is None:
        return None
    return (
        f"MuJoCo's contact is a spring with a time constant of {case.engine.solref[0]:g} s; a "
        "smaller one in the solref of the geoms makes it stiffer"
    )


def _tumbled(e: Evidence) -> Iterator[Finding]:
    if e.tumbled_step is None:
        return
    tilts = tilt_rad(e.case)
    tilt_deg = math.degrees(tilts[e.tumbled_step])
    how = f"touches the floor tilted by {tilt_deg:.2g}°"
    how += "" if e.case.is_box else " from how it was released"
    advice = "; drop it flat with --orientation and without --spin"
    if e.law is not None and e.case.scenario.solver_residual != 0:
        advice = (
            "; to see what the solver's early stop does to that, compare with --solver-residual 0"
        )
    if e.tumbled_step and tilts[e.tumbled_step - 1] <= FLAT_RAD:
        how = f"is turned by {tilt_deg:.2g}° in the step that touches the floor"
        advice = ""  # whatever turned it: an edge that met the floor first, friction, a neighbour
    yield Finding(
        "tumbled",
        f"from {e.case.time_s[e.tumbled_step]:.4g} s (step {e.tumbled_step}) on it "
        f"{'tumbles' if tumbles(e.case, e.tumbled_step) else 'is not flat'}: it "
        f"{how}, so bounces, contact and rest are measured from there "
        f"on, not predicted{advice}",
    )


def _bounces(e: Evidence) -> Iterator[Finding]:
    asked = e.case.engine.pair_restitution
    if not asked or e.impact is None:
        return
    for number, bounce in enumerate(e.bounces, start=1):
        if bounce.correction_m_s is None or bounce.effective_restitution is None:
            continue
        excess = bounce.effective_restitution - asked
        advice = "call p.setPhysicsEngineParameter(contactERP=0), i.e. --contact-erp 0"
        if bounce.uncorrected_apex_m is None:  # too deep: without it, it would stay inside
            advice = "shorten the step with p.setTimeStep, i.e. --timestep"
        if bounce.correction_m_s > 0 and excess > INFLATED * asked:
            yield Finding(
                "restitution-inflated",
                f"bounce {number} has a restitution of {bounce.effective_restitution:.4f} where "
                f"{asked:g} (body × floor) was asked for: the position correction adds "
                f"{bounce.correction_m_s:.3f} m/s to the rebound; {advice}",
            )
            break
    yield from _swallowed(e)


def _swallowed(e: Evidence) -> Iterator[Finding]:
    """Report the first arrival that stays although it would bounce without the threshold."""
    threshold_m_s, restitution = restitution_threshold_m_s(e.case), e.case.engine.pair_restitution
    if restitution is None or e.case.is_springy or not e.case.is_bullet:
        return
    # What gravity takes back within a step or two is no bounce either.
    least_m_s = max(SWALLOWED_M_S, -2 * e.case.fall.gravity_m_s2 * e.case.timestep_s) / restitution
    points = e.case.samples.contact_points
    for number, episode in enumerate(episodes(e.case)):
        if e.tumbled_step is not None and episode.first >= e.tumbled_step:
            return
        flat = e.case.is_ball or (e.case.is_box and points[episode.first] == CORNERS)
        if flat and not episode.leaves and least_m_s < episode.approach_m_s < threshold_m_s:
            yield Finding(
                "bounce-swallowed",
                f"after {number} bounce{'s' * (number != 1)} the body arrives at "
                f"{episode.approach_m_s:.3f} m/s and stays: restitution acts only from "
                f"{threshold_m_s:g} m/s on; lower it with "
                "p.setPhysicsEngineParameter(restitutionVelocityThreshold=…), i.e. "
                "--restitution-threshold",
            )
            return


def _rest_below_expected(e: Evidence) -> Iterator[Finding]:
    rest = e.rest
    if rest is None or rest.error_m is None or rest.error_m >= -REST_BELOW_M:
        return
    lower = f"the body lies {decimals(-rest.error_m * 1e6, 2)} µm lower than {rest.expected_m:g} m"
    if e.case.is_springy:
        yield Finding("rest-below-expected", f"{lower}: {_spring(e.case)}")
    elif rest.terms_m is not None:
        causes = "Bullet leaves a slop of 10 µm uncorrected"
        if abs(rest.terms_m.solver) > SOLVER_M:
            causes += f" and its solver stops {_solver_stop(e.case)} the solver's part away"
            causes += ", the slop stays"
        else:
            causes += ", unless p.setPhysicsEngineParameter(contactSlop=0) is called"
        yield Finding("rest-below-expected", f"{lower}: {causes}")
    elif rest.sinks_m is not None:
        yield Finding(
            "rest-below-expected",
            f"{lower}, where {_points(e.case)} carry the weight: {_soft(e.case)}",
        )
    elif e.case.scenario.contact_erp == 0 and e.law is not None and e.tumbled_step is None:
        yield Finding(
            "rest-below-expected",
            f"{lower}: with a contact ERP of 0 nothing takes a penetration back; omit "
            "--contact-erp 0",
        )


def _points(case: Case) -> str:
    return counted(int(case.samples.contact_points[-1]), "point")


def _solver_stop(case: Case) -> str:
    """Say where the solver stops, and what takes that away; which came first is not recorded."""
    iterations = case.engine.solver_iterations or ENOUGH_ITERATIONS
    if case.scenario.solver_residual == 0:
        return f"after {counted(iterations, 'iteration')}; more with --solver-iterations take"
    if iterations < ENOUGH_ITERATIONS:
        return f"early; --solver-residual 0 and more than {iterations} --solver-iterations take"
    return "early; --solver-residual 0 takes"


def _still_airborne(e: Evidence) -> Iterator[Finding]:
    case, height_m = e.case, float(e.case.samples.height_m[-1])
    falling = case.fall.gravity_m_s2 < 0 and case.scenario.stepped and e.mismatch is None
    falling = falling and case.is_rigid  # of links PyBullet does not report every contact
    floor_m = case.floor_height_m
    if not falling or floor_m is None or e.phases.contact_step is not None or height_m <= floor_m:
        return
    if not case.over_floor(case.samples.position_m[-1:]):
        return
    outcome = "nothing has touched yet; let it go on with --duration to see whether it lands"
    if e.landing is not None:
        times = [f"free fall lands at {e.landing.time_free_fall_s:.4g} s"]
        damped_s = e.landing.time_damped_s
        if damped_s is not None and any(case.fall.drag) and e.clamped_step is None:
            times.append(f"damped fall at {e.landing.time_damped_s:.4g} s")
        outcome = (
            f"the recording ends before the impact ({', '.join(times)}); let it go on with "
            "--duration"
        )
    yield Finding(
        "still-airborne",
        f"after {case.time_s[-1]:.4g} s the centre is still at {decimals(height_m, 4)} m: "
        f"{outcome}",
    )

"""Findings: the common mistakes and surprises that a recording reveals.

Each finding says what was seen, with the number, why it is so, and the one call or option that
changes it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.drop.case import FLOOR_REACH_M, TOUCHING_M, Case
from drop_physics.analysis.drop.convergence import GROWS, cancelling_timestep
from drop_physics.analysis.drop.landing import CORNERS, Path, episodes, restitution_threshold_m_s
from drop_physics.analysis.drop.mismatch import Mismatch
from drop_physics.analysis.drop.phases import Phases
from drop_physics.analysis.drop.posture import FLAT_RAD, extent_m, tilt_rad, tumbles
from drop_physics.analysis.drop.results import Bounce, Finding, Impact, Landing, Moment, Rest
from drop_physics.fields import counted, decimals
from drop_physics.laws import mujoco_contact
from drop_physics.laws.bullet_contact import CONTACT_SLOP_M
from drop_physics.messages import Message, joined

DEEP_PENETRATION = 0.1
"""Share of the body's height that it may sink into the floor before it is worth reporting."""
REST_BELOW_M = 1e-6
"""A body that rests further than this below its rest height is worth reporting."""
SOLVER_ITERATIONS = 50
"""Bullet's default, unless the residual stops the solver earlier."""
SOLVER_M = 1e-8
"""Error of a rest height due to the solver's early stop that is worth reporting."""
INFLATED = 0.01
"""Relative excess of a rebound over the restitution asked for that is worth reporting."""
SWALLOWED_M_S = 0.01
"""A rebound slower than this is not missed."""


@dataclass(frozen=True)
class Evidence:
    """What the findings are drawn from: the case and the results of its analysis."""

    case: Case
    phases: Phases
    mismatch: Mismatch | None
    clamped_step: int | None
    """First sample at which a velocity is clamped to Bullet's limit."""
    moment: Moment | None
    """The sample whose error is broken down first."""
    landing: Landing | None
    impact: Impact | None
    tumbled_step: int | None
    bounces: list[Bounce]
    rest: Rest | None
    law: Path | None
    """The path by the contact law, where that covers the drop."""


def findings(evidence: Evidence) -> list[Finding]:
    """Return the findings on a recording, the gravest first."""
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
        seen = Message(
            "the engine's gravity is 0 m/s² and the centre is at {height} m at the end",
            height=decimals(heights_m[-1], 4),
        )
        advice = Message(
            "PyBullet starts without gravity; call p.setGravity(0, 0, -9.81), i.e. omit "
            "--no-gravity"
        )
        if not e.case.is_bullet:
            advice = Message("omit --no-gravity")
        yield Finding("no-gravity", joined(": ", [seen, advice]))
    if not scenario.stepped and e.mismatch is None:
        seen = Message(
            "all {samples} samples are the same to the last bit, at {height} m",
            samples=len(heights_m),
            height=decimals(heights_m[0], 4),
        )
        advice = Message(
            "time passes only in p.stepSimulation(); call it once per sample, i.e. omit --no-step"
        )
        if not e.case.is_bullet:
            advice = Message("omit --no-step")
        yield Finding("not-stepped", joined(": ", [seen, advice]))


def _shorten_step(case: Case, *, times: int | None = None) -> Message:
    """Return the advice to shorten the timestep, and how many times at least."""
    if times is not None and case.is_bullet:
        return Message(
            "make the step {times} times shorter with p.setTimeStep, i.e. --timestep", times=times
        )
    if times is not None:
        return Message("make the step {times} times shorter with --timestep", times=times)
    if case.is_bullet:
        return Message("shorten the step with p.setTimeStep, i.e. --timestep")
    return Message("shorten the step with --timestep")


def _joints(e: Evidence) -> Iterator[Finding]:
    if not e.case.is_rigid:
        yield Finding(
            "joints-not-explained",
            Message(
                "the body has {joints}: the laws here are those of one rigid body, so its motion "
                "and its contacts are recorded but not explained; drop a body of one link with "
                "--body",
                joints=counted(e.case.engine.joints, "joint"),
            ),
        )


def _no_floor(e: Evidence) -> Iterator[Finding]:
    position_m, floor_m = e.case.samples.position_m, e.case.engine.rest_height_m
    lowest_m = float(position_m[:, 2].min())
    if floor_m is None or e.mismatch is not None:
        return
    if not e.case.scenario.floor and lowest_m < floor_m <= e.case.fall.height_m:
        seen = Message(
            "the centre went down to {height} m without a contact: there is nothing to land on",
            height=decimals(lowest_m, 4),
        )
        advice = Message('call p.loadURDF("plane.urdf"), i.e. omit --no-floor')
        if not e.case.is_bullet:
            advice = Message("omit --no-floor")
        yield Finding("no-floor", joined("; ", [seen, advice]))
    low = position_m[:, 2] + e.case.engine.reach_m < 0
    if e.case.scenario.floor and low.any() and not e.case.over_floor(position_m[low][:1]):
        yield Finding(
            "no-floor",
            Message(
                "the centre went down to {height} m past the floor's edge: plane.urdf ends "
                "{reach:g} m from the origin; throw less far with --velocity",
                height=decimals(lowest_m, 4),
                reach=FLOOR_REACH_M,
            ),
        )


def _tunnelled(e: Evidence) -> Iterator[Finding]:
    step, position_m = _through(e), e.case.samples.position_m
    if step is None:
        return
    seen = Message(
        "at {time:.4g} s (step {step}) the body is below the floor, its centre at {height} m, and "
        "nothing has touched",
        time=e.case.time_s[step],
        step=step,
        height=decimals(position_m[step, 2], 4),
    )
    reason: Message | None = None
    if e.case.engine.shape == "none":
        reason = Message("the body has no collision shape; add a <collision> to the URDF of --body")
    elif not _overlapped(e.case, step):
        reason = Message(
            "it moved {moved:.4g} m in a step, and contact is checked only between steps; {advice}",
            moved=float(np.linalg.norm(position_m[step] - position_m[step - 1])),
            advice=_shorten_step(e.case),
        )
    elif e.case.is_bullet:
        reason = Message(
            "it has overlapped the floor without a contact: its collision is disabled; look for a "
            "collision filter in the URDF of --body, or p.setCollisionFilterGroupMask"
        )
    yield Finding("tunnelled", joined(": ", [seen, *filter(None, [reason])]))


def _through(e: Evidence) -> int | None:
    """Return the first sample at which the body is below the floor as a whole.

    None where contact brought it back.
    """
    if not (e.case.scenario.floor and e.case.starts_above):
        return None
    position_m = e.case.samples.position_m
    below = position_m[:, 2] + e.case.engine.reach_m < 0
    untouched = np.flatnonzero(below[: e.phases.airborne])
    returned = e.phases.contact_step is not None and not below[-1]
    if not len(untouched) or returned or not e.case.over_floor(position_m[untouched[0] :]):
        return None
    return int(untouched[0])


def _overlapped(case: Case, step: int) -> bool:
    """Whether a step before a sample began inside the floor; also where none can meet it.

    PyBullet's floor is 10 m thick. Of other engines' only the surface is known to be met.
    """
    floor_m, tall_m, heights_m = case.floor_height_m, extent_m(case), case.samples.height_m[:step]
    if floor_m is None:
        return True
    inside = heights_m < floor_m - 1e-6
    if not case.is_bullet and tall_m is not None:
        inside &= heights_m > floor_m - tall_m
    return bool(inside.any())


def _law_mismatch(e: Evidence) -> Iterator[Finding]:
    if e.mismatch is None:
        return
    engine = e.case.engine
    name, version = e.case.engine_name, engine.engine_version
    if e.case.is_bullet:
        name, version = "pybullet", engine.pybullet_version
    reason = Message(
        "the state was altered, or another engine made it; record it again with drop simulate"
    )
    if e.case.scenario.stepped:
        seen = Message(
            "sample {step} is {deviation:.2g} (m or m/s) away from what {engine} {version} "
            "computes from the samples before it",
            step=e.mismatch.step,
            deviation=e.mismatch.deviation,
            engine=name,
            version=version or "?",
        )
    else:
        seen = Message(
            "sample {step} is {deviation:.2g} (m or m/s) away from the release, although no step "
            "was taken",
            step=e.mismatch.step,
            deviation=e.mismatch.deviation,
        )
    yield Finding("law-mismatch", joined(": ", [seen, reason]))


def _starts_in_contact(e: Evidence) -> Iterator[Finding]:
    floor_m, height_m = e.case.floor_height_m, e.case.fall.height_m
    if floor_m is None or e.case.starts_above:
        return
    seen = Message("the body is released touching the floor")
    if height_m <= floor_m - TOUCHING_M:
        seen = Message(
            "the body is released {depth:.4g} mm inside the floor", depth=(floor_m - height_m) * 1e3
        )
    advice = Message(
        "there is no fall to compare with theory; release it above {height:.6g} m with --height",
        height=floor_m,
    )
    yield Finding("starts-in-contact", joined(": ", [seen, advice]))


def _damping(e: Evidence) -> Iterator[Finding]:
    is_set = e.case.scenario.linear_damping is not None
    if is_set or not e.case.scenario.stepped or not e.case.is_bullet:
        return
    if e.case.scenario.coordinates == "maximal":
        yield Finding(
            "no-damping-in-maximal-coordinates",
            Message(
                "linear damping is 0: a btRigidBody (useMaximalCoordinates=True) has none by "
                "default, where a btMultiBody has 0.04; --linear-damping sets it, which slows a "
                "btRigidBody by another law: v' = v (1 - damping)^dt"
            ),
        )
    elif e.moment is not None and e.moment.terms_m is not None and e.moment.terms_m.damping:
        # All that would vanish without damping: its effect on the timestep's share too.
        moves_m = e.moment.terms_m.damping + e.moment.terms_m.interaction
        yield Finding(
            "default-damping",
            Message(
                "damping moves the body by {moved} mm at {time:.4g} s: PyBullet damps every body "
                "with 0.04 by default; call p.changeDynamics(body, -1, linearDamping=0), i.e. "
                "--linear-damping 0",
                moved=decimals(moves_m * 1e3, 2, "+"),
                time=e.moment.time_s,
            ),
        )


def _velocity_clamped(e: Evidence) -> Iterator[Finding]:
    if e.clamped_step is not None:
        state = e.case.samples
        fastest = np.abs(np.hstack((state.velocity_m_s, state.spin_rad_s))).max(axis=1)
        yield Finding(
            "velocity-clamped",
            Message(
                "a velocity reaches {velocity:.6g} (m/s or rad/s) at {time:.4g} s and is clamped "
                "there: a btMultiBody limits every component to ±100; use --coordinates maximal",
                velocity=fastest[e.clamped_step],
                time=e.case.time_s[e.clamped_step],
            ),
        )


def _refining_hurts(e: Evidence) -> Iterator[Finding]:
    if e.moment is None or e.moment.terms_m is None:
        return
    terms = e.moment.terms_m
    cancel_s = cancelling_timestep(
        e.case.timestep_s,
        timestep_m=terms.timestep,
        damping_m=terms.damping,
        interaction_m=terms.interaction,
    )
    if cancel_s is None or cancel_s > e.moment.time_s:
        return
    if abs(terms.damping) > GROWS * abs(e.moment.error_m):
        yield Finding(
            "refining-hurts",
            Message(
                "at {time:.4g} s the error is {error} mm and tends to {limit} mm as the timestep "
                "shrinks: the timestep's share and the damping's cancel at {timestep} s; break the "
                "error down before refining, or switch the damping off with --linear-damping 0",
                time=e.moment.time_s,
                error=decimals(e.moment.error_m * 1e3, 2, "+"),
                limit=decimals(terms.damping * 1e3, 2, "+"),
                timestep=_rate(cancel_s),
            ),
        )


def _rate(timestep_s: float) -> str:
    """Write a timestep as people set it: 1/341, or 0.4 where that is clearer."""
    return f"1/{1 / timestep_s:.0f}" if timestep_s < 0.1 else f"{timestep_s:.3g}"


def _deep_penetration(e: Evidence) -> Iterator[Finding]:
    tall_m = extent_m(e.case)
    if e.impact is None or e.impact.penetration_m is None or tall_m is None:
        return
    depth_m, released_above = e.impact.penetration_m, e.case.starts_above
    # From the first force on, or in a later landing, how deep it gets is not the step's alone.
    unhindered = e.impact.lowest_step < e.phases.airborne
    if released_above and unhindered and depth_m > DEEP_PENETRATION * tall_m:
        per_step_m = abs(float(e.case.samples.velocity_m_s[e.phases.airborne - 1, 2]))
        per_step_m *= e.case.substep_s
        # It cannot get deeper than it moves in a step; a tenth more, for gravity in that step.
        times = math.ceil(1.1 * per_step_m / (DEEP_PENETRATION * tall_m))
        advice, soft = _shorten_step(e.case, times=times), _spring(e.case) or _soft(e.case)
        if soft is not None:
            advice = Message(
                "in a shorter one, how deep it sinks depends on how soft the contact is: {soft}",
                soft=soft,
            )
        reason = Message(
            "contact acts only once it is inside, and it moves {moved} mm down in a step; {advice}",
            moved=decimals(per_step_m * 1e3, 1),
            advice=advice,
        )
        seen = Message(
            "the body sinks {depth} mm into the floor, {share:.0%} of its height",
            depth=decimals(depth_m * 1e3, 1),
            share=depth_m / tall_m,
        )
        yield Finding("deep-penetration", joined(": ", [seen, reason]))


def _spring(case: Case) -> Message | None:
    """Say why contact gives way, where the body asks for that."""
    if not case.is_springy:
        return None
    return Message(
        "the body's URDF makes its contact a spring of {stiffness:g} N/m; omit <stiffness> and "
        "<damping> from its <contact>, or set them with p.changeDynamics",
        stiffness=case.engine.contact_stiffness_n_m,
    )


def _soft(case: Case) -> Message | None:
    """Say why contact gives way where a shorter timestep does not help."""
    if case.engine.modulus_pa is not None:
        return Message(
            "Drake's contact is compliant, with a modulus of {modulus:.0e} Pa; a larger one among "
            "the proximity properties of the shape makes it stiffer",
            modulus=case.engine.modulus_pa,
        )
    if case.engine.solref is None:
        return None
    if case.engine.solref[0] <= mujoco_contact.shortest_s(case.timestep_s):
        return Message(
            "MuJoCo's contact is a spring with a time constant of {time:g} s, never below two "
            "timesteps; a smaller one in the solref of the geoms makes it stiffer with a shorter "
            "--timestep only",
            time=mujoco_contact.shortest_s(case.timestep_s),
        )
    return Message(
        "MuJoCo's contact is a spring with a time constant of {time:g} s; a smaller one in the "
        "solref of the geoms makes it stiffer",
        time=case.engine.solref[0],
    )


def _tumbled(e: Evidence) -> Iterator[Finding]:
    if e.tumbled_step is None:
        return
    tilts = tilt_rad(e.case, slice(e.tumbled_step + 1))
    when = {"time": e.case.time_s[e.tumbled_step], "step": e.tumbled_step}
    seen = Message("from {time:.4g} s (step {step}) on it is not flat", **when)
    if tumbles(e.case, e.tumbled_step):
        seen = Message("from {time:.4g} s (step {step}) on it tumbles", **when)
    tilt_deg = math.degrees(tilts[e.tumbled_step])
    tilt = f"{tilt_deg:.2g}" if tilt_deg < 10 else f"{tilt_deg:.0f}"
    how = Message("it touches the floor tilted by {tilt}°", tilt=tilt)
    if not e.case.is_box:
        how = Message("it touches the floor tilted by {tilt}° from how it was released", tilt=tilt)
    advice = []
    if e.case.is_box and (any(e.case.scenario.spin_rad_s) or tilts[0] > FLAT_RAD):
        advice = [Message("drop it flat with --orientation and without --spin")]
    if e.law is not None and e.case.scenario.solver_residual != 0:
        advice = [
            Message(
                "to see the effect of the solver's early stop on that, compare with "
                "--solver-residual 0"
            )
        ]
    if e.tumbled_step and tilts[e.tumbled_step - 1] <= FLAT_RAD:
        how = Message("it is turned by {tilt}° in the step that touches the floor", tilt=tilt)
        advice = []  # whatever turned it: an edge that met the floor first, friction, a neighbour
    reason = Message(
        "{how}, so bounces, contact and rest are measured from there on, not predicted", how=how
    )
    yield Finding("tumbled", joined("; ", [joined(": ", [seen, reason]), *advice]))


def _bounces(e: Evidence) -> Iterator[Finding]:
    asked = e.case.engine.pair_restitution
    if not asked or e.impact is None:
        return
    for number, bounce in enumerate(e.bounces, start=1):
        if bounce.correction_m_s is None or bounce.effective_restitution is None:
            continue
        excess = bounce.effective_restitution - asked
        advice = Message("call p.setPhysicsEngineParameter(contactERP=0), i.e. --contact-erp 0")
        if not _comes_out(e.case, bounce, asked):
            advice = Message(
                "call p.setPhysicsEngineParameter(contactERP=0), i.e. --contact-erp 0, and shorten "
                "the step with --timestep, or the body may then stay inside the floor"
            )
        if bounce.correction_m_s > 0 and excess > INFLATED * asked:
            yield Finding(
                "restitution-inflated",
                Message(
                    "bounce {number} has a restitution of {restitution:.4f} where {asked:g} (body "
                    "× floor) was asked for: the position correction adds {added:.3f} m/s to the "
                    "rebound; {advice}",
                    number=number,
                    restitution=bounce.effective_restitution,
                    asked=asked,
                    added=bounce.correction_m_s,
                    advice=advice,
                ),
            )
            break
    yield from _swallowed(e)


def _comes_out(case: Case, bounce: Bounce, restitution: float) -> bool:
    """Whether a rebound by restitution alone surely lifts a body out of the floor."""
    assert case.floor_height_m is not None
    speed_m_s, depth_m = restitution * bounce.approach_m_s, case.floor_height_m
    depth_m -= float(case.samples.height_m[bounce.step])
    rise_m = speed_m_s**2 / (-2 * case.fall.gravity_m_s2) - speed_m_s * case.timestep_s
    return rise_m > depth_m


def _swallowed(e: Evidence) -> Iterator[Finding]:
    """Report the first arrival that stays although it would bounce without the threshold."""
    threshold_m_s, restitution = restitution_threshold_m_s(e.case), e.case.engine.pair_restitution
    if restitution is None or e.case.is_springy or not e.case.is_bullet:
        return
    # A rebound that gravity stops within a step or two is not a bounce either.
    least_m_s = max(SWALLOWED_M_S, -2 * e.case.fall.gravity_m_s2 * e.case.timestep_s) / restitution
    points = e.case.samples.contact_points
    for number, episode in enumerate(episodes(e.case)):
        if e.tumbled_step is not None and episode.first >= e.tumbled_step:
            return
        flat = e.case.is_ball or (e.case.is_box and points[episode.first] == CORNERS)
        if flat and not episode.leaves and least_m_s < episode.approach_m_s < threshold_m_s:
            yield Finding(
                "bounce-swallowed",
                Message(
                    "after {bounces} the body arrives at {speed:.3f} m/s and stays: restitution "
                    "acts only from {threshold:g} m/s on; lower that with "
                    "p.setPhysicsEngineParameter(restitutionVelocityThreshold=…), i.e. "
                    "--restitution-threshold",
                    bounces=counted(number, "bounce"),
                    speed=episode.approach_m_s,
                    threshold=threshold_m_s,
                ),
            )
            return


def _rest_below_expected(e: Evidence) -> Iterator[Finding]:
    rest = e.rest
    if rest is None or rest.error_m is None or rest.error_m >= -REST_BELOW_M:
        return
    lower = Message(
        "the body lies {depth} µm lower than {expected:g} m",
        depth=decimals(-rest.error_m * 1e6, 2),
        expected=rest.expected_m,
    )
    reason: Message | None = None
    if e.case.is_springy:
        if -rest.error_m > CONTACT_SLOP_M:
            reason = Message(
                "Bullet leaves a slop of 10 µm uncorrected, unless "
                "p.setPhysicsEngineParameter(contactSlop=0) is called, and the body's URDF makes "
                "its contact a spring of {stiffness:g} N/m, which gives way by the rest; make it "
                "stiffer with <stiffness> in its <contact>, or with p.changeDynamics",
                stiffness=e.case.engine.contact_stiffness_n_m,
            )
    elif rest.terms_m is not None:
        reason = Message(
            "Bullet leaves a slop of 10 µm uncorrected, unless "
            "p.setPhysicsEngineParameter(contactSlop=0) is called"
        )
        if abs(rest.terms_m.solver) > SOLVER_M:
            reason = _solver_stop(e.case)
    elif rest.sinks_m is not None:
        points = counted(int(e.case.samples.contact_points[-1]), "point")
        lower = Message("{lower}, carried by {points}", lower=lower, points=points)
        reason = _soft(e.case)
    elif e.case.scenario.contact_erp == 0 and e.law is not None and e.tumbled_step is None:
        reason = Message(
            "with a contact ERP of 0 penetration is never corrected; omit --contact-erp 0"
        )
    if reason is not None:
        yield Finding("rest-below-expected", joined(": ", [lower, reason]))


def _solver_stop(case: Case) -> Message:
    """Say where the solver stops, and what prevents it; which came first is not recorded."""
    iterations = case.engine.solver_iterations or SOLVER_ITERATIONS
    if case.scenario.solver_residual == 0:
        return Message(
            "Bullet leaves a slop of 10 µm uncorrected and its solver stops after {iterations}; "
            "more with --solver-iterations remove the solver's part, the slop stays",
            iterations=counted(iterations, "iteration"),
        )
    return Message(
        "Bullet leaves a slop of 10 µm uncorrected and its solver stops early; --solver-residual 0 "
        "and more than {iterations} --solver-iterations remove the solver's part, the slop stays",
        iterations=iterations,
    )


def _still_airborne(e: Evidence) -> Iterator[Finding]:
    case, height_m = e.case, float(e.case.samples.height_m[-1])
    falling = case.fall.gravity_m_s2 < 0 and case.scenario.stepped and e.mismatch is None
    falling = falling and case.is_rigid  # of links PyBullet does not report every contact
    floor_m = case.floor_height_m
    if not falling or floor_m is None or e.phases.contact_step is not None or height_m <= floor_m:
        return
    if _through(e) is not None:
        return
    if not case.over_floor(case.samples.position_m[-1:]):
        return
    outcome = Message("nothing has touched yet; extend --duration to see whether it lands")
    if e.landing is not None:
        free_s, damped_s = e.landing.time_free_fall_s, e.landing.time_damped_s
        outcome = Message(
            "the recording ends before the impact (free fall lands at {free:.4g} s); extend it "
            "with --duration",
            free=free_s,
        )
        if damped_s is not None and any(case.fall.drag) and e.clamped_step is None:
            outcome = Message(
                "the recording ends before the impact (free fall lands at {free:.4g} s, damped "
                "fall at {damped:.4g} s); extend it with --duration",
                free=free_s,
                damped=damped_s,
            )
    seen = Message(
        "after {time:.4g} s the centre is still at {height} m",
        time=case.time_s[-1],
        height=decimals(height_m, 4),
    )
    yield Finding("still-airborne", joined(": ", [seen, outcome]))

"""Findings: the common mistakes and surprises that a recording reveals.

Each finding says what was seen, with the number, why it is so, and the one call or option that
changes it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.analysis.answers.answer import Finding
from drop_physics.analysis.drop.case import FLOOR_REACH_M, TOUCHING_M, Case
from drop_physics.analysis.drop.convergence import GROWS, cancelling_timestep
from drop_physics.analysis.drop.evidence import Evidence, found, shorten_step
from drop_physics.analysis.drop.findings_on_landing import findings_on_landing
from drop_physics.analysis.drop.posture import extent_m
from drop_physics.analysis.drop.results import Moment
from drop_physics.fields import decimals
from drop_physics.messages import Message, joined


def findings(evidence: Evidence) -> list[Finding]:
    """Return the findings on a recording, the gravest first."""
    each_found = [
        *_never_moved(evidence),
        *_no_floor(evidence),
        *_tunnelled(evidence),
        *_law_mismatch(evidence),
        *_starts_in_contact(evidence),
        *_damping(evidence),
        *_velocity_clamped(evidence),
        *_refining_hurts(evidence),
        *findings_on_landing(evidence),
        *_still_airborne(evidence),
    ]
    return sorted(each_found, key=lambda each: each.rank)


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
        yield found("no-gravity", seen, advice)
    if not scenario.stepped and e.mismatch_step is None:
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
        yield found("not-stepped", seen, advice)


def _no_floor(e: Evidence) -> Iterator[Finding]:
    position_m, floor_m = e.case.samples.position_m, e.case.engine.rest_height_m
    lowest_m = float(position_m[:, 2].min())
    if floor_m is None or e.mismatch_step is not None:
        return
    if not e.case.scenario.floor and lowest_m < floor_m <= e.case.fall.height_m:
        seen = Message(
            "the centre went down to {height} m without a contact: there is nothing to land on",
            height=decimals(lowest_m, 4),
        )
        advice = Message('call p.loadURDF("plane.urdf"), i.e. omit --no-floor')
        if not e.case.is_bullet:
            advice = Message("omit --no-floor")
        yield found("no-floor", seen, advice)
    low = position_m[:, 2] + e.case.engine.reach_m < 0
    if e.case.scenario.floor and low.any() and not e.case.over_floor(position_m[low][:1]):
        seen = Message(
            "the centre went down to {height} m past the floor's edge: plane.urdf ends {reach:g} m "
            "from the origin",
            height=decimals(lowest_m, 4),
            reach=FLOOR_REACH_M,
        )
        yield found("no-floor", seen, Message("throw less far with --velocity"))


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
    advice: Message | None = None
    if e.case.engine.shape == "none":
        reason = Message("the body has no collision shape")
        advice = Message("add a <collision> to the URDF of --body")
    elif not _overlapped(e.case, step):
        reason = Message(
            "it moved {moved:.4g} m in a step, and contact is checked only between steps",
            moved=float(np.linalg.norm(position_m[step] - position_m[step - 1])),
        )
        advice = shorten_step(e.case)
    elif e.case.is_bullet:
        reason = Message("it has overlapped the floor without a contact: its collision is disabled")
        advice = Message(
            "look for a collision filter in the URDF of --body, or p.setCollisionFilterGroupMask"
        )
    yield found("tunnelled", joined(": ", [seen, *filter(None, [reason])]), advice, first=step)


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
    if e.mismatch_step is None:
        return
    engine = e.case.engine
    name, version = e.case.engine_name, engine.engine_version
    if e.case.is_bullet:
        name, version = "pybullet", engine.pybullet_version
    advice = Message(
        "the state was altered, or another engine made it; record it again with drop simulate"
    )
    seen = Message(
        "sample {step} is not what {engine} {version} computes from the sample before it",
        step=e.mismatch_step,
        engine=name,
        version=version or "?",
    )
    if not e.mismatch_step:
        seen = Message("the first sample is not the release that was asked for")
    elif not e.case.scenario.stepped:
        seen = Message(
            "sample {step} is not the release, although no step was taken", step=e.mismatch_step
        )
    yield found("law-mismatch", seen, advice, first=e.mismatch_step)


def _starts_in_contact(e: Evidence) -> Iterator[Finding]:
    floor_m, height_m = e.case.floor_height_m, e.case.fall.height_m
    if floor_m is None or e.case.starts_above:
        return
    seen = Message("the body is released touching the floor")
    if height_m <= floor_m - TOUCHING_M:
        seen = Message(
            "the body is released {depth:.4g} mm inside the floor", depth=(floor_m - height_m) * 1e3
        )
    why = Message("there is no fall to compare with theory")
    advice = Message("release it above {height:.6g} m with --height", height=floor_m)
    yield found("starts-in-contact", joined(": ", [seen, why]), advice)


def _damping(e: Evidence) -> Iterator[Finding]:
    """Report a damping that nobody asked for, or the lack of it."""
    is_set = e.case.scenario.linear_damping is not None
    if is_set or not e.case.scenario.stepped or not e.case.is_bullet:
        return
    if e.case.scenario.coordinates == "maximal":
        seen = Message(
            "linear damping is 0: a btRigidBody (useMaximalCoordinates=True) has none by default, "
            "where a btMultiBody has 0.04"
        )
        advice = Message(
            "--linear-damping sets it, which slows a btRigidBody by another law: "
            "v' = v (1 - damping)^dt"
        )
        yield found("no-damping-in-maximal-coordinates", seen, advice)
    elif e.moment is not None and e.moment.terms_m is not None and e.moment.terms_m.damping:
        # All that would vanish without damping: its effect on the timestep's share too.
        moves_m = e.moment.terms_m.damping + e.moment.terms_m.interaction
        how = {"moved": decimals(moves_m * 1e3, 2, "+"), "time": e.moment.time_s}
        seen = Message(
            "damping moves the body by {moved} mm at {time:.4g} s: PyBullet damps every body with "
            "0.04 by default",
            **how,
        )
        if _cancelling_s(e) is not None:
            seen = Message(
                "damping moves the body by {moved} mm at {time:.4g} s (0.04 by default), and hides "
                "the timestep's error: shorter steps lead from {error} to {limit} mm",
                **how,
                **_refined(e.moment),
            )
        advice = Message(
            "call p.changeDynamics(body, -1, linearDamping=0), i.e. --linear-damping 0"
        )
        yield found("default-damping", seen, advice, metres=moves_m, case=e.case)


def _velocity_clamped(e: Evidence) -> Iterator[Finding]:
    if e.clamped_step is not None:
        state = e.case.samples
        fastest = np.abs(np.hstack((state.velocity_m_s, state.spin_rad_s))).max(axis=1)
        seen = Message(
            "a velocity reaches {velocity:.6g} (m/s or rad/s) at {time:.4g} s and is clamped "
            "there: a btMultiBody limits every component to ±100",
            velocity=fastest[e.clamped_step],
            time=e.case.time_s[e.clamped_step],
        )
        advice = Message("use --coordinates maximal")
        yield found("velocity-clamped", seen, advice, first=e.clamped_step)


def _refining_hurts(e: Evidence) -> Iterator[Finding]:
    """Report that a damping which was asked for hides the timestep's error."""
    cancel_s = _cancelling_s(e)
    if cancel_s is None or e.moment is None or e.case.scenario.linear_damping is None:
        return
    seen = Message(
        "damping hides the timestep's error: at {time:.4g} s both cancel with a timestep of "
        "{timestep} s, and shorter steps lead from {error} to {limit} mm",
        time=e.moment.time_s,
        timestep=_rate(cancel_s),
        **_refined(e.moment),
    )
    advice = Message(
        "break the error down before refining, or switch the damping off with --linear-damping 0"
    )
    yield found("refining-hurts", seen, advice, metres=e.moment.error_m, case=e.case)


def _refined(moment: Moment) -> dict[str, str]:
    """Return the error of a moment, and what it tends to as the timestep shrinks [mm]."""
    assert moment.terms_m is not None
    errors_m = {"error": moment.error_m, "limit": moment.terms_m.damping}
    return {name: decimals(error_m * 1e3, 2, "+") for name, error_m in errors_m.items()}


def _cancelling_s(e: Evidence) -> float | None:
    """Return the timestep at which the damping cancels its error; None where none hides it."""
    if e.moment is None or e.moment.terms_m is None:
        return None
    terms = e.moment.terms_m
    cancel_s = cancelling_timestep(
        e.case.timestep_s,
        timestep_m=terms.timestep,
        damping_m=terms.damping,
        interaction_m=terms.interaction,
    )
    if cancel_s is None or cancel_s > e.moment.time_s:
        return None
    return cancel_s if abs(terms.damping) > GROWS * abs(e.moment.error_m) else None


def _rate(timestep_s: float) -> str:
    """Write a timestep as people set it: 1/341, or 0.4 where that is clearer."""
    return f"1/{1 / timestep_s:.0f}" if timestep_s < 0.1 else f"{timestep_s:.3g}"


def _still_airborne(e: Evidence) -> Iterator[Finding]:
    case, height_m = e.case, float(e.case.samples.height_m[-1])
    falling = case.fall.gravity_m_s2 < 0 and case.scenario.stepped and e.mismatch_step is None
    falling = falling and case.is_rigid  # of links PyBullet does not report every contact
    floor_m = case.floor_height_m
    if not falling or floor_m is None or e.phases.contact_step is not None or height_m <= floor_m:
        return
    if _through(e) is not None:
        return
    if not case.over_floor(case.samples.position_m[-1:]):
        return
    outcome = Message("nothing has touched yet")
    advice = Message("extend --duration to see whether it lands")
    if e.landing is not None:
        free_s, damped_s = e.landing.time_free_fall_s, e.landing.time_damped_s
        outcome = Message(
            "the recording ends before the impact (free fall lands at {free:.4g} s)", free=free_s
        )
        advice = Message("extend it with --duration")
        if damped_s is not None and any(case.fall.drag) and e.clamped_step is None:
            outcome = Message(
                "the recording ends before the impact (free fall lands at {free:.4g} s, damped "
                "fall at {damped:.4g} s)",
                free=free_s,
                damped=damped_s,
            )
    seen = Message(
        "after {time:.4g} s the centre is still at {height} m",
        time=case.time_s[-1],
        height=decimals(height_m, 4),
    )
    yield found("still-airborne", joined(": ", [seen, outcome]), advice)

"""Findings: the common mistakes and surprises that a drop reveals.

Each says what was seen, with the number, why it is so, and where it is sure the one call or option
that changes it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from drop_physics.drop.analysis import Fall
from drop_physics.drop.case import TOUCHING_M, Case
from drop_physics.drop.landing import restitution_threshold_m_s
from drop_physics.drop.posture import extent_m, tilt_rad
from drop_physics.fields import counted, decimals, fraction
from drop_physics.messages import Message, joined
from drop_physics.rules.answer import Cure, Effect, Finding, Level, Span
from drop_physics.trace.states import BODY_LABEL

LEVEL_OF: dict[str, Level] = {
    "law-mismatch": "broken", "tunnelled": "broken",
    "no-gravity": "asked", "not-stepped": "asked", "no-floor": "asked",
    "starts-in-contact": "asked", "velocity-clamped": "asked", "bounce-swallowed": "asked",
    "default-damping": "model", "deep-penetration": "model", "restitution-inflated": "model",
    "rest-below-expected": "model", "tumbled": "note", "still-airborne": "note",
}  # fmt: skip
MISTAKES = {
    "no-gravity": (
        Message(
            "PyBullet starts without gravity; call p.setGravity(0, 0, -9.81), i.e. omit "
            "--no-gravity"
        ),
        Message("omit --no-gravity"),
    ),
    "not-stepped": (
        Message(
            "time passes only in p.stepSimulation(); call it once per sample, i.e. omit --no-step"
        ),
        Message("omit --no-step"),
    ),
    "no-floor": (
        Message('call p.loadURDF("plane.urdf"), i.e. omit --no-floor'),
        Message("omit --no-floor"),
    ),
}
"""How to undo what an option left out: in PyBullet, and in other engines."""
DEEP_PENETRATION = 0.1
"""Share of the body's height that it may sink into the floor before it is worth reporting."""
REST_BELOW_M = 1e-6
"""A body that rests further than this below its rest height is worth reporting."""
SOLVER_M = 1e-8
"""Error of a rest height due to the solver's early stop that is worth reporting."""
INFLATED = 0.01
"""Relative excess of a rebound over the restitution asked for that is worth reporting."""
SWALLOWED_M_S = 0.01
"""A rebound slower than this is not missed."""


def findings(fall: Fall, mismatch_step: int | None) -> list[Finding]:
    """Return the findings on a drop, the gravest first.

    `mismatch_step`: the first sample that the law covers and does not lead to.
    """
    followed = [*_not_stepped(fall), *_no_floor(fall), *_still_airborne(fall)]
    if mismatch_step is not None:
        followed = [_law_mismatch(fall.case, mismatch_step)]
    each_found = [
        *_no_gravity(fall),
        *followed,
        *_tunnelled(fall),
        *_starts_in_contact(fall),
        *_default_damping(fall),
        *_velocity_clamped(fall),
        *_deep_penetration(fall),
        *_tumbled(fall),
        *_inflated(fall),
        *_swallowed(fall),
        *_rest_below_expected(fall),
    ]
    return sorted(each_found, key=lambda each: each.rank)


def _found(
    code: str,
    message: Message,
    advice: Message | None = None,
    *,
    metres: float | None = None,
    case: Case | None = None,
    first: int | None = None,
    cure: Cure | None = None,
) -> Finding:
    """Return a finding; `metres` are ranked by the body's size, `first` is a step.

    The call of its cure is the scenario's option.
    """
    size_m = max(case.engine.reach_m, 1e-12) if case is not None else math.inf
    return Finding(
        code=code,
        level=LEVEL_OF[code],
        message=message,
        advice=advice,
        cure=cure,
        effect=None if metres is None else Effect(abs(metres), "m"),
        share=0.0 if metres is None else abs(metres) / size_m,
        steps=None if first is None else Span(first, first, 1),
    )


def _mistake(code: str, message: Message, case: Case, cure: Cure | None = None) -> Finding:
    in_bullet, elsewhere = MISTAKES[code]
    return _found(code, message, in_bullet if case.is_bullet else elsewhere, cure=cure)


def _no_gravity(fall: Fall) -> Iterator[Finding]:
    if not fall.case.scenario.gravity_set:
        seen = Message(
            "the engine's gravity is 0 m/s² and the centre is at {height} m at the end",
            height=decimals(fall.case.end.height_m[0], 4),
        )
        cure = Cure("gravity", value=fall.case.scenario.gravity_m_s2, call="omit --no-gravity")
        yield _mistake("no-gravity", seen, fall.case, cure)


def _not_stepped(fall: Fall) -> Iterator[Finding]:
    if not fall.case.scenario.stepped:
        seen = Message(
            "all {samples} samples are the same to the last bit, at {height} m",
            samples=fall.case.samples,
            height=decimals(fall.case.start.height_m[0], 4),
        )
        yield _mistake("not-stepped", seen, fall.case)


def _no_floor(fall: Fall) -> Iterator[Finding]:
    case, floor_m = fall.case, fall.case.engine.rest_height_m
    lowest_m = _lowest_m(fall)
    if floor_m is not None and not case.scenario.floor and lowest_m < floor_m <= case.fall.height_m:
        seen = Message(
            "the centre went down to {height} m without a contact: there is nothing to land on",
            height=decimals(lowest_m, 4),
        )
        yield _mistake("no-floor", seen, case)


def _lowest_m(fall: Fall) -> float:
    assert fall.course.lowest is not None
    return float(fall.course.lowest[0].position_m[0, 2])


def _law_mismatch(case: Case, step: int) -> Finding:
    name, version = case.engine_name, case.engine.engine_version
    if case.is_bullet:
        name, version = "pybullet", case.engine.pybullet_version
    seen = Message(
        "sample {step} is not what {engine} {version} computes from the sample before it",
        step=step,
        engine=name,
        version=version or "?",
    )
    if not step or not case.scenario.stepped:
        seen = Message("sample {step} is not the release that was asked for", step=step)
    advice = Message(
        "the state was altered, or another engine made it; record it again with drop simulate"
    )
    return _found("law-mismatch", seen, advice, first=step)


def _tunnelled(fall: Fall) -> Iterator[Finding]:
    step, case, through = fall.course.through_step(), fall.case, fall.course.through
    if step is None or through is None:
        return
    before_m, position_m = through[0].position_m[0], case.sample(step).position_m[0]
    seen = Message(
        "at {time:.4g} s (step {step}) the body is below the floor, its centre at {height} m, and "
        "nothing has touched",
        time=step * case.timestep_s,
        step=step,
        height=decimals(position_m[2], 4),
    )
    why, advice = Message("nothing of it collides with the floor"), None
    if case.engine.shape != "none" and not fall.course.overlapped:
        why = Message(
            "it moved {moved:.4g} m in a step, and contact is checked only between steps",
            moved=float(np.linalg.norm(position_m - before_m)),
        )
        advice = Message("use a shorter timestep: --timestep")
    yield _found("tunnelled", joined(": ", [seen, why]), advice, first=step)


def _starts_in_contact(fall: Fall) -> Iterator[Finding]:
    floor_m, height_m = fall.case.floor_height_m, fall.case.fall.height_m
    if floor_m is None or fall.case.starts_above:
        return
    seen = Message("the body is released touching the floor")
    if height_m <= floor_m - TOUCHING_M:
        seen = Message(
            "the body is released {depth:.4g} mm inside the floor", depth=(floor_m - height_m) * 1e3
        )
    why = Message("there is no fall to compare with theory")
    advice = Message("release it above {height:.6g} m with --height", height=floor_m)
    yield _found("starts-in-contact", joined(": ", [seen, why]), advice)


def _default_damping(fall: Fall) -> Iterator[Finding]:
    moment = next(iter(fall.analysis.at), None)
    if fall.case.scenario.linear_damping is not None or not fall.case.is_bullet:
        return
    if moment is not None and moment.terms_m is not None and moment.terms_m.damping:
        # All that would vanish without damping: its effect on the timestep's share too.
        moved_m = moment.terms_m.damping + moment.terms_m.interaction
        values = {"moved": decimals(moved_m * 1e3, 2, "+"), "time": moment.time_s}
        seen = Message(
            "damping moves the body by {moved} mm at {time:.4g} s: PyBullet damps every body with "
            "0.04 by default",
            **values,
        )
        # With the timestep, all terms but this one vanish.
        if abs(moment.terms_m.damping) > abs(moment.error_m):
            seen = Message(
                "damping moves the body by {moved} mm at {time:.4g} s (0.04 by default), and hides "
                "the timestep's error: shorter steps lead from {error} to {limit} mm",
                error=decimals(moment.error_m * 1e3, 2, "+"),
                limit=decimals(moment.terms_m.damping * 1e3, 2, "+"),
                **values,
            )
        advice = Message(
            "call p.changeDynamics(body, -1, linearDamping=0), i.e. --linear-damping 0"
        )
        cure = Cure("damping", BODY_LABEL, 0.0, call="--linear-damping 0")
        yield _found("default-damping", seen, advice, metres=moved_m, case=fall.case, cure=cure)


def _velocity_clamped(fall: Fall) -> Iterator[Finding]:
    step = fall.course.air.clamped_step
    if step is not None:
        state = fall.case.sample(step)
        seen = Message(
            "a velocity reaches {velocity:.6g} (m/s or rad/s) at {time:.4g} s and is clamped "
            "there: a btMultiBody limits every component to ±100",
            velocity=np.abs((state.velocity_m_s, state.spin_rad_s)).max(),
            time=step * fall.case.timestep_s,
        )
        yield _found("velocity-clamped", seen, Message("use --coordinates maximal"), first=step)


# -- contact --------------------------------------------------------------------------------------


def _deep_penetration(fall: Fall) -> Iterator[Finding]:
    case, impact, tall_m = fall.case, fall.analysis.impact, extent_m(fall.case)
    depth_m = None if impact is None else impact.penetration_m
    if impact is None or depth_m is None or tall_m is None or not case.starts_above:
        return
    # From the first force on, or in a later landing, how deep it gets is not the step's alone.
    if impact.lowest_step >= fall.phases.airborne or depth_m <= DEEP_PENETRATION * tall_m:
        return
    per_step_m = abs(float(fall.course.arriving.velocity_m_s[0, 2])) * case.substep_s
    seen = Message(
        "the body sinks {depth} mm into the floor, {share:.0%} of its height: contact acts only "
        "once it is inside, and it moves {moved} mm down in a step",
        depth=decimals(depth_m * 1e3, 1),
        share=depth_m / tall_m,
        moved=decimals(per_step_m * 1e3, 1),
    )
    advice = cure = None
    if not case.is_soft:
        # It cannot get deeper than it moves in a step; a tenth more, for gravity in that step.
        times = math.ceil(1.1 * per_step_m / (DEEP_PENETRATION * tall_m))
        timestep = fraction(case.timestep_s / times)
        advice = Message(
            "use a timestep {times} times shorter: --timestep {timestep}",
            times=times,
            timestep=timestep,
        )
        cure = Cure("timestep", value=float(times), call=f"--timestep {timestep}")
    yield _found(
        "deep-penetration", seen, advice, metres=depth_m, case=case, first=impact.step, cure=cure
    )


def _tumbled(fall: Fall) -> Iterator[Finding]:
    step = fall.analysis.tumbled_step
    if step is not None:
        tilt_deg = math.degrees(tilt_rad(fall.case, fall.case.sample(step).orientation)[0])
        seen = Message(
            "from {time:.4g} s (step {step}) on it is not flat: it touches the floor tilted by "
            "{tilt}°, so bounces, contact and rest are measured from there on, not predicted",
            time=step * fall.case.timestep_s,
            step=step,
            tilt=f"{tilt_deg:.2g}" if tilt_deg < 10 else f"{tilt_deg:.0f}",
        )
        yield _found("tumbled", seen, first=step)


def _inflated(fall: Fall) -> Iterator[Finding]:
    """Report the first rebound that the position correction makes too fast."""
    asked = fall.case.engine.pair_restitution
    if not asked or fall.analysis.impact is None:
        return
    for number, bounce in enumerate(fall.analysis.bounces, start=1):
        added, restitution = bounce.correction_m_s, bounce.effective_restitution
        if added and restitution and added > 0 and restitution - asked > INFLATED * asked:
            seen = Message(
                "bounce {number} has a restitution of {restitution:.4f} where {asked:g} (body × "
                "floor) was asked for: the position correction, which --contact-erp sets, adds "
                "{added:.3f} m/s to the rebound",
                number=number,
                restitution=restitution,
                asked=asked,
                added=added,
            )
            yield _found("restitution-inflated", seen, first=bounce.step)
            return


def _swallowed(fall: Fall) -> Iterator[Finding]:
    """Report the first arrival that stays although it would bounce without the threshold."""
    case, tumbled = fall.case, fall.analysis.tumbled_step
    threshold_m_s, restitution = restitution_threshold_m_s(case), case.engine.pair_restitution
    if not restitution or case.is_springy or not case.is_bullet:
        return
    # A rebound that gravity stops within a step or two is not a bounce either.
    least_m_s = max(SWALLOWED_M_S, -2 * case.fall.gravity_m_s2 * case.timestep_s) / restitution
    for number, touchdown in enumerate(fall.course.touchdowns.found()):
        if tumbled is not None and touchdown.first >= tumbled:
            return
        flat = case.is_ball or (case.is_box and touchdown.lands_flat)
        if flat and not touchdown.leaves and least_m_s < touchdown.approach_m_s < threshold_m_s:
            seen = Message(
                "after {bounces} the body arrives at {speed:.3f} m/s and stays: restitution acts "
                "only from {threshold:g} m/s on",
                bounces=counted(number, "bounce"),
                speed=touchdown.approach_m_s,
                threshold=threshold_m_s,
            )
            advice = Message(
                "lower that with p.setPhysicsEngineParameter(restitutionVelocityThreshold=…), i.e. "
                "--restitution-threshold"
            )
            yield _found("bounce-swallowed", seen, advice, first=touchdown.first)
            return


def _rest_below_expected(fall: Fall) -> Iterator[Finding]:
    rest = fall.analysis.rest
    if rest is None or rest.terms_m is None or rest.error_m is None:
        return
    if rest.error_m >= -REST_BELOW_M:
        return
    lower = Message(
        "the body lies {depth} µm lower than {expected:g} m",
        depth=decimals(-rest.error_m * 1e6, 2),
        expected=rest.expected_m,
    )
    why = Message(
        "Bullet leaves a slop of 10 µm uncorrected, unless "
        "p.setPhysicsEngineParameter(contactSlop=0) is called"
    )
    advice = None
    if abs(rest.terms_m.solver) > SOLVER_M:
        why = Message("Bullet leaves a slop of 10 µm uncorrected and its solver stops early")
        advice = Message(
            "--solver-residual 0 and more --solver-iterations remove the solver's part, the slop "
            "stays"
        )
    yield _found(
        "rest-below-expected",
        joined(": ", [lower, why]),
        advice,
        metres=rest.error_m,
        case=fall.case,
    )


def _still_airborne(fall: Fall) -> Iterator[Finding]:
    case, height_m = fall.case, float(fall.case.end.height_m[0])
    floor_m, falling = case.floor_height_m, case.scenario.stepped and case.fall.gravity_m_s2 < 0
    # Of links PyBullet does not report every contact.
    touched = fall.phases.contact_step is not None or not case.is_rigid
    if not falling or touched or floor_m is None or height_m <= floor_m:
        return
    if fall.course.through_step() is None and case.over_floor(case.end.position_m):
        seen = Message(
            "after {time:.4g} s the centre is still at {height} m: nothing has touched yet",
            time=case.end_s,
            height=decimals(height_m, 4),
        )
        yield _found("still-airborne", seen, Message("extend it with --duration"))

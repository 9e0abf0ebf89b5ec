"""Findings: the common mistakes and surprises that a drop reveals.

A finding states an observation with its number, the reason, and, if it is certain, the call or
option that changes it. The rules are similar to those for scripts, but apply to a fall as a whole
instead of a table, since they need the theory of the fall: the error against free fall, the height
at which the body touches the floor, the options of the scenario.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from drop_physics.drop.analysis import Fall
from drop_physics.drop.case import TOUCHING_M
from drop_physics.drop.landing import restitution_threshold_m_s
from drop_physics.drop.posture import extent_m, tilt_rad
from drop_physics.fields import counted, decimals, fraction
from drop_physics.messages import Message, joined
from drop_physics.rules.answer import Cure, Effect, Finding, Span
from drop_physics.rules.codes import Level
from drop_physics.rules.every import RULES as SCRIPT_RULES
from drop_physics.rules.rule import Rule
from drop_physics.trace.states import BODY_LABEL


@dataclass(frozen=True, kw_only=True)
class Said:
    """The numbers and words that a rule reports about a drop."""

    message: Message
    advice: Message | None = None
    cure: Cure | None = None
    effect: Effect | None = None
    share: float = 0.0
    steps: Span | None = None


Says = Callable[[Fall], Iterator[Said]]

DEEP_PENETRATION = 0.1
"""Share of the body's height from which a penetration of the floor is reported."""
REST_BELOW_M = 1e-6
"""Smallest distance of a body below its expected rest height that is reported [m]."""
SOLVER_M = 1e-8
"""Smallest rest-height error due to the solver's early stop that is reported [m]."""
INFLATED = 0.01
"""Smallest relative excess of a rebound over the requested restitution that is reported."""
SWALLOWED_M_S = 0.01
"""Smallest speed of a missing rebound that is reported [m/s]."""
NEEDS_LAW = "not-stepped", "no-floor", "still-airborne"
"""Codes that are not reported if a drop's samples do not follow from one another."""
RULES: list[Rule] = []
"""All rules for a drop, in the order in which findings of equal rank are listed."""


def drop_rule(code: str, level: Level) -> Callable[[Says], Rule]:
    """Return a decorator that turns a function of a fall into a rule for a drop."""

    def made(says: Says) -> Rule:
        RULES.append(Rule(code, level, "inputs", says, proof="call"))
        return RULES[-1]

    return made


def findings(fall: Fall) -> list[Finding]:
    """Return the findings about a drop, the most serious first."""
    left_out = () if fall.mismatch_step is None else NEEDS_LAW
    found = [
        Finding(code=rule.code, level=rule.level, proof=rule.proof, **vars(said))
        for rule in RULES
        if rule.code not in left_out and (said := next(rule.matches(fall), None))
    ]
    return sorted(found, key=lambda each: each.rank)


def _ranked(fall: Fall, metres: float, said: Said) -> Said:
    """Return a finding's sentence with its effect, a length, ranked relative to the body's size."""
    effect = Effect(abs(metres), "m")
    return replace(said, effect=effect, share=effect.value / max(fall.case.engine.reach_m, 1e-12))


def _undone(fall: Fall, in_bullet: Message, elsewhere: Message) -> Message:
    """Return the call or option that restores an omitted part, in PyBullet or elsewhere."""
    return in_bullet if fall.case.is_bullet else elsewhere


@drop_rule("no-gravity", "asked")
def no_gravity(fall: Fall) -> Iterator[Said]:
    """A drop's scenario leaves out gravity."""
    if not fall.case.scenario.gravity_set:
        yield Said(
            message=Message(
                "the engine's gravity is 0 m/s² and the centre is at {height} m at the end",
                height=decimals(fall.case.end.height_m[0], 4),
            ),
            advice=_undone(
                fall,
                Message(
                    "PyBullet starts without gravity; call p.setGravity(0, 0, -9.81), i.e. omit "
                    "--no-gravity"
                ),
                Message("omit --no-gravity"),
            ),
            cure=Cure("gravity", value=fall.case.scenario.gravity_m_s2, call="omit --no-gravity"),
        )


@drop_rule("not-stepped", "asked")
def not_stepped(fall: Fall) -> Iterator[Said]:
    """A drop's scenario makes no step."""
    if not fall.case.scenario.stepped:
        yield Said(
            message=Message(
                "all {samples} samples are the same to the last bit, at {height} m",
                samples=fall.case.samples,
                height=decimals(fall.case.start.height_m[0], 4),
            ),
            advice=_undone(
                fall,
                Message(
                    "time passes only in p.stepSimulation(); call it once per sample, i.e. omit "
                    "--no-step"
                ),
                Message("omit --no-step"),
            ),
        )


@drop_rule("no-floor", "asked")
def no_floor(fall: Fall) -> Iterator[Said]:
    """A dropped body falls past the height of a missing floor."""
    case, floor_m, lowest_m = fall.case, fall.case.engine.rest_height_m, fall.course.lowest_m
    if floor_m is not None and not case.scenario.floor and lowest_m < floor_m <= case.fall.height_m:
        yield Said(
            message=Message(
                "the centre went down to {height} m without a contact: there is nothing to land on",
                height=decimals(lowest_m, 4),
            ),
            advice=_undone(
                fall,
                Message('call p.loadURDF("plane.urdf"), i.e. omit --no-floor'),
                Message("omit --no-floor"),
            ),
        )


@drop_rule("still-airborne", "note")
def still_airborne(fall: Fall) -> Iterator[Said]:
    """A dropped body is above the floor at the end, and has touched nothing."""
    case, height_m = fall.case, float(fall.case.end.height_m[0])
    floor_m, falling = case.floor_height_m, case.scenario.stepped and case.fall.gravity_m_s2 < 0
    # Of links PyBullet does not report every contact.
    touched = fall.phases.contact_step is not None or not case.is_rigid
    if not falling or touched or floor_m is None or height_m <= floor_m:
        return
    if fall.course.through_step() is not None or not case.over_floor(case.end.position_m):
        return
    yield Said(
        message=Message(
            "after {time:.4g} s the centre is still at {height} m: nothing has touched yet",
            time=case.end_s,
            height=decimals(height_m, 4),
        ),
        advice=Message("extend it with --duration"),
    )


@drop_rule("law-mismatch", "broken")
def law_mismatch(fall: Fall) -> Iterator[Said]:
    """A drop's sample does not follow from the previous one by the engine's law, or the release."""
    case, step = fall.case, fall.mismatch_step
    if step is None:
        return
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
    yield Said(
        message=seen,
        advice=Message(
            "the state was altered, or another engine made it; record it again with drop simulate"
        ),
        steps=_at(step),
    )


@drop_rule("tunnelled", "broken")
def tunnelled(fall: Fall) -> Iterator[Said]:
    """A dropped body is entirely below the floor, without any contact."""
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
    yield Said(message=joined(": ", [seen, why]), advice=advice, steps=_at(step))


@drop_rule("starts-in-contact", "asked")
def starts_in_contact(fall: Fall) -> Iterator[Said]:
    """A body is released at the floor or inside it, so that no fall can be compared."""
    floor_m, height_m = fall.case.floor_height_m, fall.case.fall.height_m
    if floor_m is None or fall.case.starts_above:
        return
    seen = Message("the body is released touching the floor")
    if height_m <= floor_m - TOUCHING_M:
        seen = Message(
            "the body is released {depth:.4g} mm inside the floor", depth=(floor_m - height_m) * 1e3
        )
    why = Message("there is no fall to compare with theory")
    yield Said(
        message=joined(": ", [seen, why]),
        advice=Message("release it above {height:.6g} m with --height", height=floor_m),
    )


@drop_rule("default-damping", "model")
def default_damping(fall: Fall) -> Iterator[Said]:
    """Damping that no option set is a term of a drop's error, and may hide the timestep's."""
    moment = next(iter(fall.analysis.at), None)
    if fall.case.scenario.linear_damping is not None or not fall.case.is_bullet:
        return
    if moment is None or moment.terms_m is None or not moment.terms_m.damping:
        return
    # All that would vanish without damping: its effect on the timestep's share too.
    moved_m, limit_m = moment.terms_m.damping + moment.terms_m.interaction, moment.terms_m.damping
    seen = Message(
        "damping moves the body by {moved} mm at {time:.4g} s: PyBullet damps every body with "
        "0.04 by default"
    )
    # With the timestep, all terms but this one vanish.
    if abs(limit_m) > abs(moment.error_m):
        seen = Message(
            "damping moves the body by {moved} mm at {time:.4g} s (0.04 by default), and hides "
            "the timestep's error: shorter steps lead from {error} to {limit} mm"
        )
    lengths_m = {"moved": moved_m, "error": moment.error_m, "limit": limit_m}
    lengths = {name: decimals(each * 1e3, 2, "+") for name, each in lengths_m.items()}
    said = Said(
        message=Message(seen.template, time=moment.time_s, **lengths),
        advice=Message("call p.changeDynamics(body, -1, linearDamping=0), i.e. --linear-damping 0"),
        cure=Cure("damping", BODY_LABEL, 0.0, call="--linear-damping 0"),
    )
    yield _ranked(fall, moved_m, said)


@drop_rule("velocity-clamped", "asked")
def velocity_clamped(fall: Fall) -> Iterator[Said]:
    """A falling body reaches the engine's limit of velocities."""
    step = fall.course.air.clamped_step
    if step is None:
        return
    state = fall.case.sample(step)
    yield Said(
        message=Message(
            "a velocity reaches {velocity:.6g} (m/s or rad/s) at {time:.4g} s and is clamped "
            "there: a btMultiBody limits every component to ±100",
            velocity=np.abs((state.velocity_m_s, state.spin_rad_s)).max(),
            time=step * fall.case.timestep_s,
        ),
        advice=Message("use --coordinates maximal"),
        steps=_at(step),
    )


# -- contact --------------------------------------------------------------------------------------


@drop_rule("deep-penetration", "model")
def deep_penetration(fall: Fall) -> Iterator[Said]:
    """A dropped body sinks into the floor by a tenth of its height before a force acts."""
    case, impact, tall_m = fall.case, fall.analysis.impact, extent_m(fall.case)
    depth_m = None if impact is None else impact.penetration_m
    if impact is None or depth_m is None or tall_m is None or not case.starts_above:
        return
    # From the first force on, or in a later landing, how deep it gets is not the step's alone.
    if impact.lowest_step >= fall.phases.airborne or depth_m <= DEEP_PENETRATION * tall_m:
        return
    per_step_m = abs(float(fall.course.arriving.velocity_m_s[0, 2])) * case.substep_s
    advice = cure = None
    if not case.is_soft:
        # It cannot get deeper than it moves in a step; a tenth more, for gravity in that step.
        times = math.ceil(1.1 * per_step_m / (DEEP_PENETRATION * tall_m))
        per_s = math.ceil(times / case.timestep_s - 1e-6)  # 1/1200 reads better than its digits
        call = f"--timestep {fraction(1 / per_s)}"
        cure = Cure("timestep", value=float(times), call=call)
        advice = Message("use a timestep {times} times shorter: {call}", times=times, call=call)
    seen = Message(
        "the body sinks {depth} mm into the floor, {share:.0%} of its height: contact acts only "
        "once it is inside, and it moves {moved} mm down in a step",
        depth=decimals(depth_m * 1e3, 1),
        share=depth_m / tall_m,
        moved=decimals(per_step_m * 1e3, 1),
    )
    said = Said(message=seen, advice=advice, cure=cure, steps=_at(impact.step))
    yield _ranked(fall, depth_m, said)


@drop_rule("tumbled", "note")
def tumbled(fall: Fall) -> Iterator[Said]:
    """A dropped body touches the floor tilted, so that bounces and rest are not predicted."""
    step = fall.analysis.tumbled_step
    if step is None:
        return
    tilt_deg = math.degrees(tilt_rad(fall.case, fall.case.sample(step).orientation)[0])
    yield Said(
        message=Message(
            "from {time:.4g} s (step {step}) on it is not flat: it touches the floor tilted by "
            "{tilt}°, so bounces, contact and rest are measured from there on, not predicted",
            time=step * fall.case.timestep_s,
            step=step,
            tilt=f"{tilt_deg:.2g}" if tilt_deg < 10 else f"{tilt_deg:.0f}",
        ),
        steps=_at(step),
    )


@drop_rule("restitution-inflated", "model")
def inflated(fall: Fall) -> Iterator[Said]:
    """Position correction makes a rebound faster than restitution alone would."""
    asked = fall.case.engine.pair_restitution
    if not asked or fall.analysis.impact is None:
        return
    for number, bounce in enumerate(fall.analysis.bounces, start=1):
        added, restitution = bounce.correction_m_s, bounce.effective_restitution
        if added and restitution and added > 0 and restitution - asked > INFLATED * asked:
            yield Said(
                message=Message(
                    "bounce {number} has a restitution of {restitution:.4f} where {asked:g} (body "
                    "× floor) was asked for: the position correction, which --contact-erp sets, "
                    "adds {added:.3f} m/s to the rebound",
                    number=number,
                    restitution=restitution,
                    asked=asked,
                    added=added,
                ),
                steps=_at(bounce.step),
            )


@drop_rule("bounce-swallowed", "asked")
def swallowed(fall: Fall) -> Iterator[Said]:
    """A dropped body stays down where it would bounce if restitution had no threshold."""
    case, tumbled_step = fall.case, fall.analysis.tumbled_step
    threshold_m_s, restitution = restitution_threshold_m_s(case), case.engine.pair_restitution
    if not restitution or case.is_springy or not case.is_bullet:
        return
    # A rebound that gravity stops within a step or two is not a bounce either.
    least_m_s = max(SWALLOWED_M_S, -2 * case.fall.gravity_m_s2 * case.timestep_s) / restitution
    for number, touchdown in enumerate(fall.course.touchdowns.found()):
        if tumbled_step is not None and touchdown.first >= tumbled_step:
            return
        flat = case.is_ball or (case.is_box and touchdown.lands_flat)
        if flat and not touchdown.leaves and least_m_s < touchdown.approach_m_s < threshold_m_s:
            yield Said(
                message=Message(
                    "after {bounces} the body arrives at {speed:.3f} m/s and stays: restitution "
                    "acts only from {threshold:g} m/s on",
                    bounces=counted(number, "bounce"),
                    speed=touchdown.approach_m_s,
                    threshold=threshold_m_s,
                ),
                advice=Message(
                    "lower that with p.setPhysicsEngineParameter(restitutionVelocityThreshold=…), "
                    "i.e. --restitution-threshold"
                ),
                steps=_at(touchdown.first),
            )


@drop_rule("rest-below-expected", "model")
def rest_below_expected(fall: Fall) -> Iterator[Said]:
    """A dropped body rests lower than its shape implies."""
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
    advice, why = (
        None,
        Message(
            "Bullet leaves a slop of 10 µm uncorrected, unless "
            "p.setPhysicsEngineParameter(contactSlop=0) is called"
        ),
    )
    if abs(rest.terms_m.solver) > SOLVER_M:
        why = Message("Bullet leaves a slop of 10 µm uncorrected and its solver stops early")
        advice = Message(
            "--solver-residual 0 and more --solver-iterations remove the solver's part, the slop "
            "stays"
        )
    yield _ranked(fall, rest.error_m, Said(message=joined(": ", [lower, why]), advice=advice))


def _at(step: int) -> Span:
    return Span(step, step, 1)


ALL_RULES = *SCRIPT_RULES, *RULES
"""The rules for scripts and those for drops, which `drop explain` describes."""

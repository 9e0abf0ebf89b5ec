"""Findings on how a drop landed, bounced and came to rest."""

from __future__ import annotations

import math
from collections.abc import Iterator

from drop_physics.analysis.answers.answer import Finding
from drop_physics.analysis.drop.case import Case
from drop_physics.analysis.drop.evidence import Evidence, found, shorten_step
from drop_physics.analysis.drop.landing import CORNERS, episodes, restitution_threshold_m_s
from drop_physics.analysis.drop.posture import FLAT_RAD, extent_m, tilt_rad, tumbles
from drop_physics.analysis.drop.results import Bounce
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


def findings_on_landing(evidence: Evidence) -> Iterator[Finding]:
    """Yield the findings on contact and rest."""
    yield from _deep_penetration(evidence)
    yield from _tumbled(evidence)
    yield from _bounces(evidence)
    yield from _rest_below_expected(evidence)


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
        advice, soft = shorten_step(e.case, times=times), _spring(e.case) or _soft(e.case)
        if soft is not None:
            advice = Message(
                "in a shorter one, how deep it sinks depends on how soft the contact is: {soft}",
                soft=soft,
            )
        reason = Message(
            "contact acts only once it is inside, and it moves {moved} mm down in a step",
            moved=decimals(per_step_m * 1e3, 1),
        )
        seen = Message(
            "the body sinks {depth} mm into the floor, {share:.0%} of its height",
            depth=decimals(depth_m * 1e3, 1),
            share=depth_m / tall_m,
        )
        yield found(
            "deep-penetration", joined(": ", [seen, reason]), advice, metres=depth_m, case=e.case,
            first=e.impact.step,
        )  # fmt: skip


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
    advice: Message | None = None
    if e.case.is_box and (any(e.case.scenario.spin_rad_s) or tilts[0] > FLAT_RAD):
        advice = Message("drop it flat with --orientation and without --spin")
    if e.law is not None and e.case.scenario.solver_residual != 0:
        advice = Message(
            "to see the effect of the solver's early stop on that, compare with --solver-residual 0"
        )
    if e.tumbled_step and tilts[e.tumbled_step - 1] <= FLAT_RAD:
        how = Message("it is turned by {tilt}° in the step that touches the floor", tilt=tilt)
        advice = None  # whatever turned it: an edge that met the floor first, friction, a neighbour
    reason = Message(
        "{how}, so bounces, contact and rest are measured from there on, not predicted", how=how
    )
    yield found("tumbled", joined(": ", [seen, reason]), advice, first=e.tumbled_step)


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
            seen = Message(
                "bounce {number} has a restitution of {restitution:.4f} where {asked:g} (body × "
                "floor) was asked for: the position correction adds {added:.3f} m/s to the rebound",
                number=number,
                restitution=bounce.effective_restitution,
                asked=asked,
                added=bounce.correction_m_s,
            )
            yield found("restitution-inflated", seen, advice, first=bounce.step)
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
            seen = Message(
                "after {bounces} the body arrives at {speed:.3f} m/s and stays: restitution acts "
                "only from {threshold:g} m/s on",
                bounces=counted(number, "bounce"),
                speed=episode.approach_m_s,
                threshold=threshold_m_s,
            )
            advice = Message(
                "lower that with p.setPhysicsEngineParameter(restitutionVelocityThreshold=…), i.e. "
                "--restitution-threshold"
            )
            yield found("bounce-swallowed", seen, advice, first=episode.first)
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
    advice: Message | None = None
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
            reason, advice = _solver_stop(e.case)
    elif rest.sinks_m is not None:
        points = counted(int(e.case.samples.contact_points[-1]), "point")
        lower = Message("{lower}, carried by {points}", lower=lower, points=points)
        reason = _soft(e.case)
    elif e.case.scenario.contact_erp == 0 and e.law is not None and e.tumbled_step is None:
        reason = Message(
            "with a contact ERP of 0 penetration is never corrected; omit --contact-erp 0"
        )
    if reason is not None:
        seen = joined(": ", [lower, reason])
        yield found("rest-below-expected", seen, advice, metres=rest.error_m, case=e.case)


def _solver_stop(case: Case) -> tuple[Message, Message]:
    """Say where the solver stops, and what prevents it; which came first is not recorded."""
    iterations = case.engine.solver_iterations or SOLVER_ITERATIONS
    if case.scenario.solver_residual == 0:
        reason = Message(
            "Bullet leaves a slop of 10 µm uncorrected and its solver stops after {iterations}",
            iterations=counted(iterations, "iteration"),
        )
        return reason, Message(
            "more with --solver-iterations remove the solver's part, the slop stays"
        )
    reason = Message("Bullet leaves a slop of 10 µm uncorrected and its solver stops early")
    return reason, Message(
        "--solver-residual 0 and more than {iterations} --solver-iterations remove the solver's "
        "part, the slop stays",
        iterations=iterations,
    )

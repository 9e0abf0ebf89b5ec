"""Rules about motors: gains, limits, joints that should follow others."""

from __future__ import annotations

import numpy as np

from drop_physics import quantities
from drop_physics.arrays import Float64
from drop_physics.explain.commands import DEFAULT
from drop_physics.explain.joints import DrivenJoints
from drop_physics.explain.targets import flips, rings_with
from drop_physics.messages import Message
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, joint_rule
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import (
    BEYOND,
    COASTS_RAD_S,
    COASTS_STEPS,
    CROSSINGS,
    FOLLOWS,
    OTHER_FORCE,
)
from drop_physics.trace.events import Body
from drop_physics.trace.motors import VELOCITY


@joint_rule("motor-gain", "asked", least_count=CROSSINGS, proposes=True)
def motor_gain(joints: JointColumns) -> Match:
    """A joint overshoots its target or reverses repeatedly because of its motor's gains.

    A motor within its force limit leaves a gap e after each step that follows e_next = (2 - kp -
    kd) e - (1 - kd) e_before.
    """
    kp, kd, at_place = joints.asked.kp, joints.asked.kd, joints.position_motor
    before, after = joints.before - joints.target, joints.after - joints.target
    visible = np.maximum(np.abs(before), np.abs(after)) > joints.at_target
    # At its limit a motor overshoots with any gains.
    passed = at_place & rings_with(kp, kd) & visible & (before * after < 0) & ~joints.at_limit
    # A velocityGain alone turns the rate around, wherever the joint is.
    rates = np.minimum(np.abs(joints.rate_before), np.abs(joints.rate))
    turned = (joints.rate_before * joints.rate < 0) & (rates > COASTS_RAD_S)
    turned &= flips(joints.driven) & joints.motor
    off = np.where(at_place, after, joints.rate - joints.target_velocity)
    numbers = {"kp": kp, "kd": kd, "at_place": at_place}
    return Match((passed | turned) & np.isfinite(kp + kd), np.abs(off), numbers)


@motor_gain.notes
def _(
    telemetry: DrivenJoints, unit: str, site: float, at_place: bool, kp: float, kd: float
) -> Noted:
    called = telemetry.site(site)
    told = [] if called is None else [name.removesuffix("s") for name in called.places]
    usual = {"positionGain": (kp, 0.1), "velocityGain": (kd, 1.0)}
    # What no call gave is PyBullet's own, and is not changed.
    gains = {name: each for name, each in usual.items() if name in told} or usual
    return {
        "unit": unit if at_place else f"{unit}/s",
        "gains": ", ".join(f"{name}={now:.4g}" for name, (now, _) in gains.items()),
        "softer": {name: to for name, (_, to) in gains.items()},
    }


motor_gain.rows(
    SayingRow(
        says=Message(
            "{joint} shakes, up to {size:gap} off its target, with {gains}: gains are shares of "
            "the gap per step"
        ),
        cure=Remedy("gains", "joint", given="softer"),
        effect="size",
    ),
)


@joint_rule("timestep-after-motor", "asked")
def timestep_after_motor(joints: JointColumns) -> Match:
    """PyBullet stores a call's force × timestep; a later timestep alters the motor's force."""
    force, limit = joints.asked.force, joints.limit / joints.steps.substeps
    share = np.round(np.abs(limit - force) / force, 9)
    given = np.abs(joints.torque) / joints.steps.substeps
    met = joints.at_limit | (given > (1 + OTHER_FORCE) * force)
    numbers = {"limit": limit, "force": force, "off": limit - force}
    return Match(met & (share > OTHER_FORCE) & joints.motor, share, numbers)


timestep_after_motor.rows(
    SayingRow(
        says=Message(
            "{joint} has a motor of {limit:N} in place of the {force:N} it was given: the timestep "
            "was changed after that call"
        ),
        cure=Remedy("timestep-first"),
        effect="off",
        unit="{effort}",
    )
)


@joint_rule("substeps-scale-motors", "asked")
def substeps_scale_motors(joints: JointColumns) -> Match:
    """A motor exerts an impulse of up to force × timestep in each substep of `numSubSteps`."""
    substeps, given = joints.steps.substeps, np.abs(joints.torque)
    force = joints.limit / substeps
    share = given / force - 1
    numbers = {"given": given, "force": force, "substeps": substeps, "excess": given - force}
    return Match((substeps > 1) & (share > OTHER_FORCE) & joints.motor, share, numbers)


substeps_scale_motors.rows(
    SayingRow(
        says=Message(
            "{joint} has a motor that gives up to {given:N}, where {force:N} is its limit: with "
            "numSubSteps={substeps:.0f} the limit counts in each substep"
        ),
        advice=Message("{call}; it then has {force:N}, and needs force={given:.3g} to do the same"),
        cure=Remedy("substeps", value="substeps"),
        effect="excess",
        unit="{effort}",
    )
)


# -- beyond-urdf ----------------------------------------------------------------------------------


FORCE = np.array([[[False, True]]])
"""Index of the plane of forces in a table with two planes."""


@joint_rule("beyond-urdf", "note", least_count=COASTS_STEPS, proposes=True)
def beyond_urdf(joints: JointColumns) -> Match:
    """`getJointInfo` reports the effort and velocity limits of a file, which motors ignore."""
    told = (joints.mode != DEFAULT) | (joints.asked.pd == 1)
    limits = [
        joints.of_joints(lambda each: each.velocity * (each.widths[1] == 1)),
        joints.of_joints(lambda each: each.effort * (each.widths[1] == 1)),
    ]
    limit, most = np.stack(limits, axis=2), np.abs(np.stack([joints.rate, joints.torque], axis=2))
    speeds = told & (joints.torque * joints.rate > 0)
    drives = np.stack([speeds, told], axis=2)
    beyond = told[:, :, None] & (limit > 0) & (most > (1 + BEYOND) * limit)
    numbers = {"limit": limit, "force": FORCE, "goal": np.abs(joints.target_velocity)}
    numbers |= {"by_rate": joints.mode == VELOCITY}
    # It is beyond in the steps in which its motor brakes it, too.
    return Match(beyond, np.where(drives, 1 - limit / most, 0.0), numbers, most={"most": most})


@beyond_urdf.counts
def _(size: Float64, limit: Float64, most: Float64) -> Float64:
    return np.where(size > 0, 1 - limit / most, 0.0)


@beyond_urdf.notes
def _(unit: str, effort: str, force: bool, most: float, limit: float) -> Noted:
    its = effort if force else f"{unit}/s"
    return {
        "unit": its,
        "allowed": f"{limit:g} {its}",
        "written": quantities.effort(most, its) if most >= 10 else f"{most:.3g} {its}",
        "excess": most - limit,
    }


beyond_urdf.rows(
    SayingRow(
        when=lambda force, by_rate, goal, limit: not force and by_rate and goal > limit,
        advice=Message("give it a targetVelocity of {limit:g} or less"),
    ),
    SayingRow(
        when=lambda force: force,
        cure=Remedy("urdf-limits", "joint", "limit", given={"force": "limit"}),
    ),
    # A motor for rates has no maxVelocity: its target is the limit.
    SayingRow(
        when=lambda by_rate: not by_rate,
        cure=Remedy("urdf-limits", "joint", "limit", given={"maxVelocity": "limit"}),
    ),
    SayingRow(),
    like=SayingRow(
        says=Message(
            "{joint}{others} reaches {written} where its file allows {allowed}, in {steps}: "
            "PyBullet's motors do not enforce that limit"
        ),
        effect="excess",
    ),
)


# -- mimic-ignored --------------------------------------------------------------------------------


@joint_rule("mimic-ignored", "asked", commanded=False)
def mimic_ignored(joints: JointColumns) -> Match | None:
    """A joint does not follow the other joint that its file's `<mimic>` names."""
    places = zip(joints.body.joints, joints.body.rates, strict=True)
    rates = {each.name: at.start for each, at in places if each.widths[1] == 1}
    pairs = [
        mimic
        for mimic in joints.body.asked.mimics
        if mimic.multiplier and {mimic.joint, mimic.of} <= rates.keys()
    ]
    if not pairs:
        return None
    own, leads = (
        np.array([rates[getattr(pair, name)] for pair in pairs]) for name in ("joint", "of")
    )
    times, offset = np.array([(pair.multiplier, pair.offset) for pair in pairs]).T
    low, high = np.array([j.limits for j in joints.body.joints for _ in range(j.widths[1])]).T
    extent = np.where(high > low, high - low, 1.0)[own]
    began, apart = (
        at[:, own] - times * at[:, leads] - offset for at in (joints.before, joints.after)
    )
    rests = joints.resting[:, own] & joints.resting[:, leads]
    drives = (joints.mode != DEFAULT) & (joints.asked.force != 0)
    # A follower whose own target is where the tag puts it is asked to follow.
    goal = np.where(joints.position_motor, joints.target, np.nan)
    follows = np.abs(goal[:, own] - times * goal[:, leads] - offset) <= FOLLOWS * extent

    def column(values: Float64) -> Float64:
        """Copy values of the following joints into an array for all joints."""
        found = np.zeros(joints.after.shape)
        found[:, own] = values
        return found

    return Match(
        column(np.ones(apart.shape)) > 0,
        column(np.abs(apart)),
        most={
            "high": column(apart),
            "low": column(-apart),
            "rested": column(np.abs(apart) * rests),
            "sent": column((drives[:, own] | drives[:, leads]) & ~follows),
        },
        firsts={"began": column(began)},
        lasts={"now": column(np.abs(apart)), "extent": column(extent + 0.0 * apart)},
        counts=(column(np.abs(apart)) > FOLLOWS * column(extent + 0.0 * apart)).astype(np.int64),
    )


@mimic_ignored.counts
def _(
    high: Float64, began: Float64, low: Float64, rested: Float64, now: Float64, extent: Float64
) -> Float64:
    moved = np.maximum(high - began, low + began)
    share = np.maximum(rested, now) / extent
    return np.where((moved > FOLLOWS * extent) & (share > FOLLOWS), share, 0.0)


@mimic_ignored.notes
def _(subject: Body, joint: str, link: int, rested: float, now: float, extent: float) -> Noted:
    mimic = next(each for each in subject.asked.mimics if each.joint == joint)
    gap = max(rested, now)
    return {
        "gap": gap,
        "of": mimic.of,
        "geared": {"ratio": f"{-1 / mimic.multiplier:g}", "link": link},
        "part": gap / extent,
    }


NOT_FOLLOWED = SayingRow(
    says=Message(
        "{joint}{others} is {gap:gap} away from where its <mimic> tag puts it: PyBullet ignores "
        "the tag, so it does not follow {of}"
    ),
    cure=Remedy("mimic", "body", given="geared"),
    effect="gap",
    share="part",
)
mimic_ignored.rows(SayingRow(when=lambda sent: sent), SayingRow(level="note"), like=NOT_FOLLOWED)

"""The rule `target-clamped`: targets and controls beyond the range of their drive."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.messages import Message
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import RADIANS, as_degrees, is_degrees, units
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, actuator_rule, joint_rule
from drop_physics.rules.tables import ActuatorColumns, JointColumns
from drop_physics.rules.thresholds import (
    BEYOND_RANGE,
    CHATTERS,
    COASTS_STEPS,
    EACH_STEP,
)
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Actuator, Body

SENT = "position", "velocity"
"""The kinds of actuators whose control is a target."""
RANGE_FREE = "motor", *SENT
"""The kinds of actuators that work without a ctrlrange, unlike dampers and adhesion."""


@actuator_rule("target-clamped", "asked", least_count=COASTS_STEPS, engines=MUJOCOS)
def control_clamped(actuators: ActuatorColumns) -> Match:
    """An actuator's control beyond its ctrlrange is clamped to the end of the range."""
    low, high, given = actuators.lower, actuators.upper, actuators.given
    share = np.maximum(low - given, given - high) / (high - low)
    beyond, sent = share > BEYOND_RANGE, np.zeros(share.shape, np.bool_)
    sent[:] = [actuator.kind in SENT for actuator in actuators.actuators]
    numbers = {"given": given, "low": low, "high": high}
    turned = beyond & (given * actuators.before < 0)
    return Match(beyond, share, numbers, sums={"turned": turned * 1.0}, lasts={"sent": sent})


@control_clamped.counts
def _(count: Int64, sent: Flags, size: Float64, ends: Int64) -> Float64:
    # Of what pushes, a range says how strong it is.
    always = count >= EACH_STEP * ends
    return np.where(sent | always, size, 0.0)


@control_clamped.notes
def _(
    actuator: Actuator,
    joint: str | None,
    subject: Body,
    given: float,
    low: float,
    high: float,
    size: float,
) -> Noted:
    unit = next((units(each)[0] for each in subject.joints if each.name == joint), "")
    placed = actuator.kind == "position"
    return {
        "free": actuator.kind in RANGE_FREE,
        "unit": unit,
        "placed": placed and unit,
        "in_degrees": placed and unit == "rad" and is_degrees(given, low, high),
        "beyond": size * (high - low),
        **as_degrees(given),
    }


SENT_BEYOND = SayingRow(
    says=Message(
        "{name} is sent to {given:.4g} in {steps}, and its ctrlrange is {low:.4g} "
        "to {high:.4g}: it takes the end of that"
    ),
    advice=Message("send it within that, or {call}"),
    cure=Remedy("ctrlrange", "name"),
    site=Act.SET_CONTROL,
)
# What gives more than a motor can may be wrong itself.
GIVEN_BEYOND = SayingRow(
    says=Message(
        "{name} is given up to {given:.4g}, beyond its ctrlrange of {low:.4g} to {high:.4g} in "
        "{steps}: it gives no more than the end of that"
    ),
    level="model",
    proposed=True,
    site=Act.SET_CONTROL,
)
control_clamped.rows(
    SayingRow(when=lambda in_degrees: in_degrees, advice=RADIANS, effect="beyond").like(
        SENT_BEYOND
    ),
    SayingRow(when=lambda placed: placed, effect="beyond").like(SENT_BEYOND),
    SayingRow(when=lambda sent: sent).like(SENT_BEYOND),
    # A greater range would let it overshoot by more.
    SayingRow(
        when=lambda turned, count: turned > CHATTERS * count,
        says=Message(
            "{name} is given up to {given:.4g}, beyond its ctrlrange of {low:.4g} to {high:.4g} in "
            "{steps}, and changes its sign in {turned:,.0f} of them: what computes it overshoots "
            "within a step"
        ),
        advice=Message("a smaller gain, or a shorter timestep"),
    ).like(GIVEN_BEYOND),
    SayingRow(when=lambda free: free, cure=Remedy("ctrlrange", "name")).like(GIVEN_BEYOND),
    SayingRow(advice=Message("give it a ctrl of {low:.4g} to {high:.4g}")).like(GIVEN_BEYOND),
)


@joint_rule("target-clamped", "asked")
def target_clamped(joints: JointColumns) -> Match:
    """PyBullet clamps a position target to the joint's limits."""
    low, high, target = joints.lower, joints.upper, joints.asked.target
    over = np.maximum(low - target, target - high)
    least = np.where(low < high, BEYOND_RANGE * (high - low), joints.at_target)
    beyond = (low <= high) & (over > least)
    numbers = {"target": target, "lower": low, "upper": high}
    return Match(joints.position_motor & beyond, over, numbers)


OTHER_LIMITS = Remedy(
    "limits", "joint", given={"jointLowerLimit": "least", "jointUpperLimit": "most"}
)


@target_clamped.notes
def _(unit: str, lower: float, upper: float, target: float, size: float) -> Noted:
    absolute = unit == "rad" or lower == upper
    return {
        "side": Message("upper") if target > upper else Message("lower"),
        "limit": upper if target > upper else lower,
        "least": min(lower, target),
        "most": max(upper, target),
        "beyond": size if absolute else size / (upper - lower),
        **as_degrees(target),
    }


target_clamped.rows(
    SayingRow(
        when=lambda unit, target, lower, upper: unit == "rad" and is_degrees(target, lower, upper),
        advice=RADIANS,
        reason="units",
    ),
    SayingRow(
        when=lambda lower, upper: lower == upper,
        advice=Message("its limits leave it no range; give it one: {call}"),
        cure=OTHER_LIMITS,
    ),
    SayingRow(
        advice=Message("give a target within {lower:.4g} and {upper:.4g}, or other limits: {call}"),
        cure=OTHER_LIMITS,
    ),
    like=SayingRow(
        says=Message(
            "{joint}{more} is sent to {target:.4g} {unit}, beyond its {side} limit of {limit:.4g} "
            "{unit}: PyBullet takes the limit as the target"
        ),
        effect="size",
        share="beyond",
    ),
)

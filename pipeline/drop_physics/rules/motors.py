"""Rules about what drives joints: each marks the steps of a robot's joints in which it holds."""

from __future__ import annotations

import numpy as np

from drop_physics.explain.targets import flips, grows_with, rings_with
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, and_more
from drop_physics.rules.joint import distance, effort
from drop_physics.rules.rule import Match, Said, Worst, joint_rule
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import BEYOND_RANGE, COASTS_RAD_S, CROSSINGS, OTHER_FORCE


@joint_rule("target-clamped", "asked")
def target_clamped(joints: JointColumns) -> Match:
    """PyBullet moves a position target beyond a joint's limit to that limit."""
    low, high, target = joints.lower, joints.upper, joints.asked.target
    over = np.maximum(low - target, target - high)
    beyond = (low < high) & (over > BEYOND_RANGE * (high - low))
    numbers = {"target": target, "lower": low, "upper": high}
    return Match(joints.position_motor & beyond, over, numbers)


@target_clamped.says
def _(worst: Worst) -> Said:
    low, high, unit = worst.lower, worst.upper, worst.unit
    over = worst.target > high
    return Said(
        message=Message(
            "{joint}{more} is sent to {target:.4g} {unit}, beyond its {side} limit of {limit:.4g} "
            "{unit}: PyBullet takes the limit as the target",
            joint=worst.joint,
            more=and_more(worst.joints),
            target=worst.target,
            unit=unit,
            side=Message("upper") if over else Message("lower"),
            limit=high if over else low,
        ),
        advice=Message(
            "give a target within {low:.4g} and {high:.4g}, or other limits by "
            "p.changeDynamics(body, {link}, jointLowerLimit=…, jointUpperLimit=…)",
            low=low,
            high=high,
            link=worst.link,
        ),
        cure=Cure("limits", worst.joint if worst.joints == 1 else worst.body),
        effect=Effect(worst.size, unit),
        share=worst.size if unit == "rad" else worst.size / (high - low),
    )


@joint_rule("motor-gain", "asked", least_count=CROSSINGS)
def motor_gain(joints: JointColumns) -> Match:
    """Off its limit a motor leaves gaps e with e' = (2 - kp - kd) e - (1 - kd) e_before."""
    kp, kd = joints.kp, joints.kd
    before, after = joints.before - joints.target, joints.after - joints.target
    grows = grows_with(kp, kd)
    # At its limit a motor does not follow its gains, unless they are why it is there.
    free = ~joints.at_limit | grows
    visible = np.maximum(np.abs(before), np.abs(after)) > joints.at_target
    rings = rings_with(kp, kd) & np.isfinite(kp + kd)
    passed = joints.position_motor & rings & free & visible & (before * after < 0)
    # A velocityGain alone turns the rate around, wherever the joint is.
    rates = np.minimum(np.abs(joints.rate_before), np.abs(joints.rate))
    turned = (joints.rate_before * joints.rate < 0) & (rates > COASTS_RAD_S)
    turned &= flips(joints.driven) & joints.motor & np.isfinite(kd)
    turned &= np.where(joints.position_motor, grows & np.isfinite(kp), kd >= 2)
    size = np.where(joints.position_motor, np.abs(after), np.abs(joints.rate))
    numbers = {"kp": kp, "kd": kd, "turned": turned & ~passed, "at_place": joints.position_motor}
    return Match(passed | turned, size, numbers)


@motor_gain.says
def _(worst: Worst) -> Said:
    kp, kd, unit = worst.kp, worst.kd, worst.unit if worst.at_place else f"{worst.unit}/s"
    half, last = (kp + kd - 2, 1 - kd) if worst.at_place else (kd - 1, 0.0)
    left = float(np.abs(np.roots([1, half, last])).max())
    each = Message("each step leaves {left:.2g} of the gap on the other side", left=left)
    if left >= 1:
        each = Message("each step makes the gap {left:.4g} times as large", left=left)
    elif half**2 < 4 * last:
        each = Message("a swing keeps {left:.2g} of its size from step to step", left=left)
    gains = {"positionGain": 0.1} if worst.at_place else {}
    gains["velocityGain"] = 1.0
    values = {
        "joint": worst.joint,
        "off": distance(worst.size, unit),
        "kp": kp,
        "kd": kd,
        "each": each,
    }
    if not worst.at_place:
        template = Message(
            "{joint} turns around with every step, at up to {off}: gains are shares per step, and "
            "with velocityGain={kd:.4g} {each}"
        )
    elif not worst.turned:
        template = Message(
            "{joint} shakes about its target, by up to {off}: gains are shares per step, and with "
            "positionGain={kp:.4g}, velocityGain={kd:.4g} {each}"
        )
    else:
        template = Message(
            "{joint} turns around with every step, {off} off its target: gains are shares per "
            "step, and with positionGain={kp:.4g}, velocityGain={kd:.4g} {each}"
        )
    return Said(
        message=Message(template, **values),
        advice=Message("p.setJointMotorControl2(…, positionGain=0.1, velocityGain=1)")
        if worst.at_place
        else Message("p.setJointMotorControl2(…, velocityGain=1)"),
        cure=Cure("gains", worst.joint, given=gains),
        effect=Effect(worst.size, unit),
    )


@joint_rule("timestep-after-motor", "asked")
def timestep_after_motor(joints: JointColumns) -> Match:
    """PyBullet keeps force × timestep of the call, which a later timestep divides again."""
    force, limit = joints.force, joints.limit / joints.steps.substeps
    share = np.round(np.abs(limit - force) / force, 9)
    given = np.abs(joints.torque) / joints.steps.substeps
    met = joints.at_limit | (given > (1 + OTHER_FORCE) * force)
    numbers = {"limit": limit, "force": force}
    return Match(met & (share > OTHER_FORCE) & joints.motor, share, numbers)


@timestep_after_motor.says
def _(worst: Worst) -> Said:
    return Said(
        message=Message(
            "{joint} has a motor of {limit} in place of the {force} it was given: the timestep was "
            "changed after that call",
            joint=worst.joint,
            limit=effort(worst.limit, worst.effort),
            force=effort(worst.force, worst.effort),
        ),
        advice=Message("call p.setTimeStep before the motors are commanded"),
        cure=Cure("timestep-first"),
        effect=Effect(abs(worst.limit - worst.force), worst.effort),
    )


@joint_rule("substeps-scale-motors", "asked")
def substeps_scale_motors(joints: JointColumns) -> Match:
    """A motor gives up to force × timestep in each substep, with `numSubSteps`."""
    substeps = np.full_like(joints.torque, joints.steps.substeps)
    given, force = np.abs(joints.torque), joints.limit / substeps
    share = given / force - 1
    numbers = {"given": given, "force": force, "substeps": substeps}
    return Match((substeps > 1) & (share > OTHER_FORCE) & joints.motor, share, numbers)


@substeps_scale_motors.says
def _(worst: Worst) -> Said:
    substeps = int(worst.substeps)
    return Said(
        message=Message(
            "{joint} has a motor that gives up to {given}, where {force} is its limit: with "
            "numSubSteps={substeps} the limit counts in each substep",
            joint=worst.joint,
            given=effort(worst.given, worst.effort),
            force=effort(worst.force, worst.effort),
            substeps=substeps,
        ),
        advice=Message(
            "in place of substeps set the timestep to 1/{substeps} of it, before the motors "
            "are commanded, and step {substeps} times; it then has {force}, and needs "
            "force={given:.3g} to do the same",
            substeps=substeps,
            force=effort(worst.force, worst.effort),
            given=worst.given,
        ),
        cure=Cure("substeps", value=float(substeps)),
        effect=Effect(worst.given - worst.force, worst.effort),
    )

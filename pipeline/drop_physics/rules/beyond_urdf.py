"""Why a robot is faster or stronger than the real one: the limits in its file do not act."""

from __future__ import annotations

import numpy as np

from drop_physics.explain.commands import DEFAULT
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.joint import effort
from drop_physics.rules.rule import Match, Said, Worst, joint_rule
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import BEYOND
from drop_physics.trace.motors import VELOCITY

FORCE = np.array([[[False, True]]])
"""The plane of forces in a table with two."""


@joint_rule("beyond-urdf", "model")
def beyond_urdf(joints: JointColumns) -> Match:
    """`getJointInfo` reports the effort and velocity of a file, and no motor heeds them."""
    told = (joints.mode != DEFAULT) | (joints.pd == 1)
    limits = [
        joints.of_joints(lambda each: each.velocity * (each.widths[1] == 1)),
        joints.of_joints(lambda each: each.effort * (each.widths[1] == 1)),
    ]
    limit, most = np.stack(limits, axis=2), np.abs(np.stack([joints.rate, joints.torque], axis=2))
    # A motor of position closes a share of its first gap in one step, however fast that is.
    speeds = told & (joints.torque * joints.rate > 0) & (joints.step > 1)[:, None]
    drives = np.stack([speeds, told], axis=2)
    beyond = told[:, :, None] & (limit > 0) & (most > (1 + BEYOND) * limit)
    # A motor for rates has no maxVelocity: its target is the limit.
    goal = np.where(joints.mode == VELOCITY, np.abs(joints.target_velocity), np.nan)
    substeps = np.full_like(joints.torque, joints.steps.substeps)
    numbers = {"most": most, "limit": limit, "force": FORCE, "goal": goal, "substeps": substeps}
    # It is beyond in the steps in which its motor brakes it, too.
    return Match(beyond, np.where(drives, 1 - limit / most, 0.0), numbers)


@beyond_urdf.says
def _(worst: Worst) -> Said:
    unit = worst.effort if worst.force else f"{worst.unit}/s"
    name = "force" if worst.force else "maxVelocity"
    advice: Message | None = Message("p.setJointMotorControl2(…, {name}={limit:g})")
    cure: Cure | None = Cure("urdf-limits", worst.joint, worst.limit, given={name: worst.limit})
    if not worst.force and not np.isnan(worst.goal):
        cure, advice = None, Message("give it a targetVelocity of {limit:g} or less")
        if worst.goal <= worst.limit:
            advice = None
    elif worst.force and worst.substeps > 1:  # what a call gives acts in each of them
        cure = advice = None
    return Said(
        message=Message(
            "{joint} reaches {most} where its file allows {limit}, in {steps}: PyBullet's "
            "motors do not enforce that limit (joints beyond theirs: {count})",
            joint=worst.joint,
            most=effort(worst.most, unit),
            limit=f"{worst.limit:g} {unit}",
            steps=worst.steps,
            count=worst.joints,
        ),
        values={"name": name},
        advice=advice,
        cure=cure,
        effect=Effect(worst.most - worst.limit, unit),
    )

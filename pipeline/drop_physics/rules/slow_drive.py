"""Rules about MuJoCo joints that move slowly: damping, dry friction, armature.

Damping, dry friction or armature of the model takes up the drive's effort. A velocity actuator is
itself a damper, and exerts no force at its target.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.joints import REST_STEPS
from drop_physics.messages import Message
from drop_physics.rules.by_name import called
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import actuators_on
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, joint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import (
    AT_TARGET_M,
    COASTS_RAD_S,
    HALF_THE_STEPS,
    HOLDS,
    SAME_SIGN,
    SLOW,
    SLOW_M_S,
    SLOW_RAD_S,
    SLOWED,
    SPRING_SHARE,
    TAKES_DRIVE,
)
from drop_physics.trace.events import Body

HELD = "contacts", "constraints", "stops", "spring", "tendon ", "joint force range"
"""Prefixes of causes that hold a joint: if one acts, the joint's own losses are not the cause."""
TAKERS = "damped", "rubbed", "swung"
"""The names of the terms that consume the drive: damping, dry friction, armature."""


def _alone(joints: JointColumns, *others: str) -> Flags:
    held = [term for term in joints.steps.terms if term.startswith(HELD) or term in others]
    return np.asarray(~np.any([joints.term(name) != 0 for name in held], axis=0))


@joint_rule("joint-damping", "model", engines=MUJOCOS)
def stays_slow(joints: JointColumns) -> Match:
    """The model's losses or armature keep a driven joint slow."""
    steps, body = joints.steps, joints.driven.body
    motors = {
        f"actuator {each.name}"
        for each in body.actuators
        if (each.kind, each.acts_on) == ("motor", "joint")
    }
    others = [term for term in steps.terms if term.startswith("actuator ") and term not in motors]
    torque = sum((joints.term(name) for name in motors), joints.term("applied"))
    net = torque + joints.term("gravity")
    # What a motor holds against gravity, or a law of another kind gives, is not given to move it.
    where = _alone(joints, *others) & (net != 0) & (net * torque >= HOLDS * torque**2)
    where &= (torque != 0) | (not body.actuators)
    slides, rotors = joints.at_target == AT_TARGET_M, steps.law.tree.armature
    armature = joints.of_joints(lambda each: 0.0 if rotors is None else rotors[each.link + 1])
    losses = joints.term("joint damping"), joints.term("friction loss")
    taken = [-loss * np.sign(net) for loss in losses]
    taken.append(armature * (joints.rate - joints.rate_before) * np.sign(net))
    sums = {"net": net, "driven": np.abs(net)}
    sums["time"] = steps.reported.timestep_s[:, None]
    numbers = {
        "rotor": armature,
        "slow": np.where(slides, SLOW_M_S, SLOW_RAD_S),
        "inertia": joints.inertia,
    }
    return Match(
        where,
        np.abs(net),
        numbers,
        sums | dict(zip(TAKERS, taken, strict=True)),
        {"fastest": np.abs(joints.rate)},
    )


@stays_slow.counts
def _(
    runs: Runs,
    inertia: Float64,
    rotor: Float64,
    driven: Float64,
    net: Float64,
    fastest: Float64,
    slow: Float64,
    count: Int64,
    ends: Int64,
) -> Float64:
    taken, which = called(_taken, runs)
    own = inertia - np.where(which == TAKERS.index("swung"), rotor, 0.0)
    holds = (taken > TAKES_DRIVE * driven) & (np.abs(net) > SAME_SIGN * driven)
    holds &= fastest < np.minimum(slow, np.abs(net) / own / SLOWED)
    # What meets something is to stay slow.
    holds &= count >= HALF_THE_STEPS * ends
    return np.where(holds, taken / driven, 0.0)


def _taken(damped: Float64, rubbed: Float64, swung: Float64) -> tuple[Float64, NDArray[np.intp]]:
    """Return which cause takes most of the drive's effort, and its share."""
    taken = np.column_stack([damped, rubbed, swung])
    return taken.max(axis=1), taken.argmax(axis=1)


@stays_slow.notes
def _(
    noted: Runs, subject: Body, link: int, unit: str, driven: float, time: float, fastest: float
) -> Noted:
    taken, which = called(_taken, noted)
    share = float(taken[0]) / driven
    return {
        "by": TAKERS[which[0]],
        "drive": driven / time,
        "takes": driven / time * share,
        "share": share,
        "rate": f"{fastest:.2g} {unit}/s",
        "damping": subject.joints[link].damping,
        "friction": subject.joints[link].friction,
    }


stays_slow.rows(
    SayingRow(
        when=lambda by: by == "damped",
        why=Message("damping of {damping:g}"),
        cure=Remedy("joint-damping", "joint", 0.0),
    ),
    SayingRow(
        when=lambda by: by == "rubbed",
        why=Message("frictionloss of {friction:g}"),
        cure=Remedy("friction", "joint", 0.0, form="loss"),
        reason="friction-loss",
    ),
    SayingRow(
        why=Message("armature of {rotor:g}"),
        cure=Remedy("armature", "joint", 0.0),
        code="armature",
    ),
    like=SayingRow(
        says=Message(
            "{joint} is driven with {drive:N} and gets no faster than {rate}: its {why} takes "
            "{share:.0%} of that"
        ),
        effect="takes",
        unit="{effort}",
        share="share",
    ),
)


@joint_rule(
    "off-target",
    "asked",
    reason="damper",
    least_count=REST_STEPS,
    consecutive=True,
    engines=MUJOCOS,
)
def servo_is_a_damper(joints: JointColumns) -> Match:
    """A joint's only actuator is a damper, which exerts force only off its target velocity."""
    goal, dt = joints.target_velocity, joints.steps.reported.timestep_s[:, None]
    kv, own = np.zeros(goal.shape), joints.torque * dt
    for k in range(goal.shape[1]):
        its = actuators_on(joints.driven.body, k)
        if [each.kind for each in its] == ["velocity"]:
            kv[:, k] = its[0].kv * its[0].gear ** 2
    gap, gains = joints.rate - goal, joints.inertia * np.abs(joints.rate - joints.rate_before)
    where = (np.abs(gap) > np.maximum(SLOW * np.abs(goal), COASTS_RAD_S)) & _alone(joints)
    where &= (kv > 0) & ~joints.at_limit & (gains < SPRING_SHARE * np.abs(own))
    numbers = {"rate": joints.rate, "goal": goal, "kv": kv, "force": joints.torque}
    # A damper that takes more than its joint's momentum in a step turns it around.
    return Match(where, np.abs(gap), numbers | {"most": joints.inertia / dt / 2})


@servo_is_a_damper.notes
def _(unit: str, goal: float, force: float, most: float, size: float) -> Noted:
    near = max(SPRING_SHARE * abs(goal), COASTS_RAD_S)
    return {
        "unit": f"{unit}/s",
        "stiffer": float(f"{min(abs(force) / near, most):.2g}"),
        "part": size / max(abs(goal), COASTS_RAD_S),
    }


servo_is_a_damper.rows(
    SayingRow(
        says=Message(
            "{joint}{more} goes at {rate:.3g} {unit} where its target is {goal:.3g}: a velocity "
            "actuator is a damper, and kv = {kv:.4g} gives the {force:N} that this takes only so "
            "far off"
        ),
        cure=Remedy("gains", "joint", "stiffer", form="kv"),
        effect="size",
        share="part",
    )
)

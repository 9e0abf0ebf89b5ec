"""`joint-damping`, `armature`, `off-target`: a MuJoCo joint stays slow.

The effort of its drive goes into the model's damping, dry friction or armature; an actuator for
rates, itself a damper, gives nothing at its target.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64
from drop_physics.explain.joints import REST_STEPS
from drop_physics.messages import Message
from drop_physics.quantities import effort
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import actuators_on
from drop_physics.rules.rows import Said, Worst
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

HELD = "contacts", "constraints", "stops", "spring", "tendon ", "joint force range"
"""Beginnings of causes: where one acts on a joint, it is not the joint itself that decides."""
TAKERS = "damped", "rubbed", "swung"
"""The names under which it is summed what takes the drive: damping, dry friction, armature."""


def _alone(joints: JointColumns, *others: str) -> Flags:
    held = [each for each in joints.steps.terms if each.startswith(HELD) or each in others]
    return np.asarray(~np.any([joints.term(name) != 0 for name in held], axis=0))


@joint_rule("joint-damping", "model", engines=MUJOCOS)
def stays_slow(joints: JointColumns) -> Match:
    """What drives a joint one way leaves it slow, where the model's losses or armature take it."""
    steps, body = joints.steps, joints.driven.body
    motors = {
        f"actuator {each.name}"
        for each in body.actuators
        if (each.kind, each.acts_on) == ("motor", "joint")
    }
    others = [each for each in steps.terms if each.startswith("actuator ") and each not in motors]
    torque = sum((joints.term(name) for name in motors), joints.term("applied"))
    net = torque + joints.term("gravity")
    # What a motor holds against gravity, or a law of another kind gives, is not given to move it.
    where = _alone(joints, *others) & (net != 0) & (net * torque >= HOLDS * torque**2)
    where &= (torque != 0) | (not body.actuators)
    slides, rotors = joints.at_target == AT_TARGET_M, steps.law.tree.armature
    armature = joints.of_joints(lambda each: 0.0 if rotors is None else rotors[each.link + 1])
    losses = joints.term("joint damping"), joints.term("friction loss")
    taken = [-each * np.sign(net) for each in losses]
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
def _(runs: Runs, scene: Scene) -> Float64:
    steps = np.array([scene.ends[number] for number in runs.keys[:, 0].tolist()])
    taken, which = _taken(runs)
    own = runs.inertia - np.where(which == TAKERS.index("swung"), runs.rotor, 0.0)
    holds = (taken > TAKES_DRIVE * runs.driven) & (np.abs(runs.net) > SAME_SIGN * runs.driven)
    holds &= runs.fastest < np.minimum(runs.slow, np.abs(runs.net) / own / SLOWED)
    # What meets something is to stay slow.
    holds &= runs.count >= HALF_THE_STEPS * steps
    return np.where(holds, taken / runs.driven, 0.0)


def _taken(runs: Runs) -> tuple[Float64, NDArray[np.intp]]:
    """Return the largest share of the drives that one cause takes, and that cause."""
    taken = np.column_stack([getattr(runs, name) for name in TAKERS])
    return taken.max(axis=1), taken.argmax(axis=1)


@stays_slow.says
def _(worst: Worst) -> Said:
    taken, which = _taken(worst.noted)
    share, k = float(taken[0]) / worst.driven, int(which[0])
    joint = worst.subject.joints[worst.link]
    what, cure = (
        (Message("damping of {n:g}", n=joint.damping), Cure("joint-damping", worst.joint, 0.0)),
        (
            Message("frictionloss of {n:g}", n=joint.friction),
            Cure("friction", worst.joint, 0.0, form="loss"),
        ),
        (Message("armature of {n:g}", n=worst.rotor), Cure("armature", worst.joint, 0.0)),
    )[k]
    drive = worst.driven / worst.time
    return Said(
        message=Message(
            "{joint} is driven with {drive} and gets no faster than {rate}: its {what} takes "
            "{share:.0%} of that"
        ),
        values={
            "drive": effort(drive, worst.effort),
            "rate": f"{worst.fastest:.2g} {worst.unit}/s",
            "what": what,
            "share": share,
        },
        cure=cure,
        code="armature" if k == 2 else None,
        reason="friction-loss" if k == 1 else None,
        effect=Effect(drive * share, worst.effort),
        share=share,
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
    """A joint's only actuator is a damper: it gives what a load takes only off its target."""
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


@servo_is_a_damper.says
def _(worst: Worst) -> Said:
    unit = f"{worst.unit}/s"
    near = max(SPRING_SHARE * abs(worst.goal), COASTS_RAD_S)
    kv = min(abs(worst.force) / near, worst.most)
    return Said(
        message=Message(
            "{joint}{more} goes at {rate:.3g} {unit} where its target is {goal:.3g}: a velocity "
            "actuator is a damper, and kv = {kv:.4g} gives the {force} that this takes only so far "
            "off"
        ),
        values={"unit": unit, "force": effort(worst.force, worst.effort)},
        cure=Cure("gains", worst.joint, float(f"{kv:.2g}"), form="kv"),
        effect=Effect(worst.size, unit),
        share=worst.size / max(abs(worst.goal), COASTS_RAD_S),
    )

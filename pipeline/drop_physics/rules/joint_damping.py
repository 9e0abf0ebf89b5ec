"""The rule `joint-damping`: losses or the armature of a joint take up what drives it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.joints import DrivenJoints
from drop_physics.messages import Message
from drop_physics.rules.answer import so_many
from drop_physics.rules.by_name import called
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.free_bodies import LOST, energy_taken, losses, lost_share
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, body_rule, joint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import BodyColumns, JointColumns
from drop_physics.rules.thresholds import (
    AT_TARGET_M,
    DAMPS_ANY,
    DAMPS_STEADY,
    HALF_THE_STEPS,
    HOLDS,
    MOVES,
    SAME_SIGN,
    SLOW_M_S,
    SLOW_RAD_S,
    SLOWED,
    TAKES_DRIVE,
)
from drop_physics.trace.events import Body

HELD = "contacts", "constraints", "stops", "spring", "tendon ", "joint force range"
"""Prefixes of causes that hold a joint: if one acts, the joint's own losses are not the cause."""
TAKERS = "damped", "rubbed", "swung"
"""The names of the terms that consume the drive: damping, dry friction, armature."""


def alone(joints: JointColumns, *others: str) -> Flags:
    """Flag the steps in which nothing else holds a joint, such as a contact or its spring."""
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
    where = alone(joints, *others) & (net != 0) & (net * torque >= HOLDS * torque**2)
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
    noted: Runs,
    subject: Body,
    link: int,
    unit: str,
    driven: float,
    time: float,
    fastest: float,
    count: int,
) -> Noted:
    taken, which = called(_taken, noted)
    share = float(taken[0]) / driven
    return {
        "by": TAKERS[which[0]],
        "drive": driven / time,
        "takes": driven / time * share,
        "share": share,
        "steps": so_many(count),
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
            "{joint} is driven with {drive:N} beyond its weight in {steps}, and gets no faster "
            "than {rate} in these: its {why} takes {share:.0%} of that"
        ),
        effect="takes",
        unit="{effort}",
        share="share",
    ),
)


@joint_rule("joint-damping", "model")
def joint_damping(joints: JointColumns) -> Match:
    """`<dynamics damping>` brakes joints driven by torques, and inverse dynamics omits it."""
    damping, applied = joints.steps.law.joint_damping, joints.term("applied")
    # One that a call set is meant.
    told = joints.of_joints(lambda each: each.damping)
    where = (applied != 0) & ~np.isnan(joints.asked.torque_since) & (damping > 0)
    drive = applied + joints.term("gravity")
    driven, taken = np.abs(drive), np.abs(joints.term("joint damping"))
    return Match(
        where & (told == damping),
        taken,
        {"damping": damping},
        {"driven": driven, "net": drive, "taken": taken},
        firsts={"torque_site": joints.asked.torque_site},
        lasts={"inertia": joints.inertia},
    )


@joint_damping.counts
def _(driven: Float64, inertia: Float64, taken: Float64, keys: Int64, net: Float64) -> Float64:
    share = np.where(driven > MOVES * inertia, taken / driven, 0.0)
    # Where it takes more than drives the joint, the rest of the robot moves that; and where it
    # takes little of what drives the robot, that goes as it would without.
    which = np.unique(keys[:, 0], return_inverse=True)[1]
    of_all, drives = (np.bincount(which, each)[which] for each in (taken, driven))
    steady = np.abs(net) > SAME_SIGN * driven
    least = np.where(steady, DAMPS_STEADY, DAMPS_ANY)
    holds = (share > least) & (share < 1 + DAMPS_STEADY) & (of_all > DAMPS_STEADY * drives)
    return np.where(holds, share, 0.0)


@joint_damping.notes
def _(telemetry: DrivenJoints, torque_site: float, taken: float, driven: float) -> Noted:
    return {"called": telemetry.cited(torque_site), "part": min(taken / driven, 1.0)}


joint_damping.rows(
    SayingRow(
        says=Message(
            "{joint}{others} is driven by torques: beyond its weight they give it {driven:N s}, "
            "and the joint damping in its file, {damping:N s/rad}, takes {taken:N s}"
        ),
        advice=Message(
            "{call}, or give torques that make up for it: p.calculateInverseDynamics leaves it out"
        ),
        cure=Remedy("joint-damping", "body", 0.0),
        effect="taken",
        unit="{effort} s",
        share="part",
        site="called",
    ),
)


@body_rule("joint-damping", "model", subject=1)
def swing_damped(bodies: BodyColumns) -> Match | None:
    """The damping in a file takes energy from joints without a motor or a torque."""
    joints = bodies.batch.bodies[0].body.joints
    told = [joint.damping for joint in joints for _ in range(joint.widths[1])]
    # One that a call set is meant.
    if not any(told) or not np.array_equal(told, bodies.law.joint_damping):
        return None
    drives = [bodies.terms[name].any(axis=1) for name in ("motors", "applied") if bodies.terms]
    return energy_taken(bodies, "joint damping", ~np.any(drives, axis=0)) if drives else None


swing_damped.counts(losses)
swing_damped.notes(lost_share)
swing_damped.rows(
    SayingRow(
        says=Message(
            "{body} swings freely and loses {taken:.3g} J to the joint damping in its file, of at "
            "most {size:.3g} J of kinetic energy"
        ),
        cure=Remedy("joint-damping", "body", 0.0),
    ),
    like=LOST,
)

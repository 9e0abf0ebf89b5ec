"""Why a joint does not move: a motor that nobody thought of holds it."""

from __future__ import annotations

from collections import Counter

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.commands import DEFAULT
from drop_physics.messages import Message
from drop_physics.physics.tree import BASE
from drop_physics.physics.vectors import lengths
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.arguments import number
from drop_physics.rules.joint import effort, link_of
from drop_physics.rules.rule import Match, Said, Worst, joint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import HALF_THE_STEPS, HOLDS, MOVES, NO_TERM, ROLLS
from drop_physics.trace.acts import Act

CAUSES = ("gravity", "contacts", "applied", "constraints")
"""Terms that ask a joint to move."""
TORQUE = np.array([[[False, True]]])
"""The plane of the table for joints that torques drive."""


@joint_rule("default-motor", "asked")
def default_motor(joints: JointColumns) -> Match | None:
    """A joint that torques, weight or a hit should move, and its motor does not let."""
    steps, default, torqued = joints.steps, joints.mode == DEFAULT, ~np.isnan(joints.torque_since)
    # Until a call gives it another motor, it was to stay where it was.
    sent = ~default & ~torqued
    on = (joints.impulse > 0) & (joints.asked.pd != 1) & steps.closes[:, None]
    on &= steps.covered and not joints.body.before
    own = on & ~torqued & default & ~sent.any(axis=0)
    carried = steps.law.tree.fixed or bool(np.any(steps.terms.get("constraints", 0)))
    terms = {name: joints.term(name) for name in steps.terms if name != "motors"}
    acting = sum(terms.values(), np.zeros(on.shape))
    largest = np.max([np.abs(each) for each in terms.values()], axis=0, initial=0.0)
    sign = np.sign(acting) * (np.abs(acting) > NO_TERM * largest)
    motor, acting = joints.term("motors"), np.abs(acting)
    sums = {
        "acting": acting * np.abs(sign),
        **{name: joints.term(name) * sign for name in CAUSES},
        "taken": np.minimum(-motor * sign, acting).clip(0),
        "time": steps.reported.timestep_s[:, None] * np.abs(sign),
    }
    planes = np.stack([own, on & torqued], axis=2)
    since = np.nan_to_num(joints.torque_since)
    most = {"most": np.abs(joints.torque), "since": since, "since_not": -since}
    most["stands"] = float(not carried)
    sums |= {"turned_by": joints.term("contacts"), "pressed": _pressed(joints)}
    lasts = {"sent": sent, "limit": joints.limit, "own": default, "motor_site": joints.asked.site}
    lasts |= {"inertia": joints.inertia, "torque_site": joints.torque_site}

    where = planes | np.stack([sent, np.zeros_like(sent)], axis=2)
    return Match(
        where,
        np.zeros(where.shape),
        {"torque": TORQUE, "site": np.nan},
        {name: each[:, :, None] * planes for name, each in sums.items()},
        most,
        lasts=lasts,
        counts=planes.astype(np.int64),
    )


def _pressed(joints: JointColumns) -> Float64:
    """Return what contacts press a body with, times the radius of each link about its joint."""
    steps, body = joints.steps, joints.body
    if steps.law.tree.fixed or "contacts" not in steps.terms or not body.bounds_m:
        return np.full(joints.target.shape, np.inf)
    pressed = lengths(steps.terms["contacts"][:, 3:6])
    edges_m = np.diff(np.reshape(body.bounds_m, (-1, 2, 3)), axis=1).max(axis=(1, 2))
    alone = joints.of_joints(
        lambda joint: float(edges_m[joint.link + 1]) / 2 if joint.widths[1] == 1 else np.inf
    )
    return np.asarray(pressed[:, None] * alone)


def _resets(runs: Runs, scene: Scene) -> Int64:
    """Return how often calls set each joint, shape (runs,)."""
    often = Counter[tuple[int, int]]()
    for use in scene.inputs.of(Act.SET_JOINT):
        if use.body is not None:
            often[use.body.number, int(number(use.first, "jointIndex", BASE))] += use.count
    joints = runs.keys[:, :2].tolist()
    return np.array([often[body, link_of(scene.body(body), k)] for body, k in joints])


@default_motor.counts
def _(runs: Runs, scene: Scene) -> Float64:
    holds = (runs.acting > MOVES * runs.inertia) & (runs.taken > HOLDS * runs.acting)
    holds &= _resets(runs, scene) < HALF_THE_STEPS * runs.count  # else calls hold it
    # Where torques began several times, it got a motor between them.
    holds &= runs.since == -runs.since_not
    # What carries a body that stands is not told apart from what should move it, but for a wheel:
    # it has no weight about its axis, and where nothing is to move it, friction turns it both ways.
    wheel = np.abs(runs.gravity) < NO_TERM * runs.contacts
    wheel &= np.abs(runs.turned_by) > ROLLS * runs.pressed
    causes = [
        np.where(runs.stands > 0, 0.0, runs.gravity),
        np.where((runs.stands > 0) & ~wheel, 0.0, runs.contacts),
        runs.applied,
        runs.constraints,
    ]
    cause = np.max(causes, axis=0) > HOLDS * runs.acting
    holds &= runs.torque | (cause & ~runs.sent)
    # Where torques are commanded, they are what the reader asks about.
    asked = np.isin(runs.keys[:, 0], runs.keys[holds & runs.torque, 0])
    return np.where(holds & (runs.torque | ~asked), runs.taken, 0.0)


@default_motor.says
def _(worst: Worst) -> Said:
    geared = worst.constraints > HOLDS * worst.acting
    if worst.torque and worst.own:
        template = Message(
            "{joint} does not follow the torques that it is given: {motor} takes up "
            "to {most}, {share:.0%} of what acts on it"
        )
    elif worst.torque:
        template = Message(
            "{joint} does not follow the torques that it is given: the motor set at {site} "
            "still acts and takes up to {most}, {share:.0%} of what acts on it"
        )
    elif worst.gravity > HOLDS * worst.acting:
        template = Message(
            "{joint} is held by {motor}: it takes {share:.0%} of its weight, {weight} on average"
        )
    elif geared:
        template = Message(
            "{joint} is held by {motor}: it takes {share:.0%} of what a constraint pulls it with, "
            "up to {most} of the {limit} that it may"
        )
    elif worst.applied > HOLDS * worst.acting:
        template = Message(
            "{joint} is held by {motor}: it takes "
            "{share:.0%} of what calls push it with, up to {most} of the {limit} that it may"
        )
    else:
        template = Message(
            "{joint} is held by {motor}: it takes "
            "what touches it, up to {most} of the {limit} that it may"
        )
    motor = Message("the velocity motor that PyBullet gives every joint")
    ball = worst.subject.joints[worst.link].kind == "spherical"
    if ball:
        motor = Message("the position motor to 0 that PyBullet gives every ball joint")
    cure = Cure("default-motor-off", worst.joint, form="ball" if ball else "")
    scene, share = worst.scene, min(worst.taken / worst.acting, 1.0)
    commanded = scene.inputs.commanded.get(worst.subject.number)
    return Said(
        level="note" if commanded and not (worst.torque or geared) else None,
        message=template,
        values={
            "motor": motor,
            "most": effort(worst.most, worst.effort),
            "site": scene.site(worst.motor_site),
            "limit": effort(worst.limit, worst.effort),
            "share": share,
            "weight": effort(worst.gravity / max(worst.time, 1e-300), worst.effort),
        },
        advice=Message("turn it off: {call}"),
        cure=cure,
        effect=Effect(worst.most, worst.effort),
        share=share,
        site=scene.site(worst.torque_site),
    )

"""Joints held by a default motor."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.explain.commands import DEFAULT
from drop_physics.messages import Message
from drop_physics.quantities import effort
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.body_properties import length_m
from drop_physics.rules.rows import Said, Worst
from drop_physics.rules.rule import Match, joint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import (
    COASTS_STEPS,
    HOLDS,
    LIMITED_OFTEN,
    MOVES,
    NO_TERM,
    ROLLS,
    SAME_SIGN,
)

CAUSES = {
    "gravity": Message("its weight"),
    "contacts": Message("contacts"),
    "applied": Message("forces that calls apply"),
    "constraints": Message("constraints"),
}
"""Terms that ask a joint to move, in words."""
TORQUE = np.array([[[False, True]]])
"""The plane of the table for joints that torques drive."""


@joint_rule("default-motor", "asked", least_count=COASTS_STEPS)
def default_motor(joints: JointColumns) -> Match | None:
    """A joint that torques, weight or a hit should move, and its motor does not let."""
    steps, default, torqued = (
        joints.steps,
        joints.mode == DEFAULT,
        ~np.isnan(joints.asked.torque_since),
    )
    # Until a call gives it another motor, it was to stay where it was.
    sent = ~default & ~torqued
    on = (joints.asked.impulse > 0) & (joints.asked.pd != 1) & (steps.closes & ~steps.put)[:, None]
    on &= steps.covered and not joints.body.before
    terms = {name: joints.term(name) for name in steps.terms if name != "motors"}
    acting = sum(terms.values(), np.zeros(on.shape))
    largest = np.max([np.abs(each) for each in terms.values()], axis=0, initial=0.0)
    sign = np.sign(acting) * (np.abs(acting) > NO_TERM * largest)
    # What carries a robot that stands is not to move it, but for the wheels of one that is to roll.
    contacts = np.abs(joints.term("contacts"))
    gravity = steps.terms.get("gravity", np.zeros((len(on), steps.law.tree.size)))
    weight = np.linalg.norm(gravity[:, : steps.law.tree.first_rate], axis=1)
    lever_m = joints.of_joints(lambda joint: length_m(joints.body, joint) / 2)
    wheel = default.all() & (np.abs(joints.term("gravity")) < NO_TERM * contacts)
    wheel &= contacts > ROLLS * weight[:, None] * lever_m
    carried = steps.law.tree.fixed or bool(np.any(steps.terms.get("constraints", 0)))
    asks = {name: carried | wheel | (name in ("applied", "constraints")) for name in CAUSES}
    acting, motor = acting * np.abs(sign), joints.term("motors")
    sums = {
        "acting": np.abs(acting),
        "net": acting,
        **{name: joints.term(name) * sign * each for name, each in asks.items()},
        "taken": np.minimum(-motor * sign, np.abs(acting)).clip(0),
        "weak": joints.at_limit,
        "time": steps.reported.timestep_s[:, None],
    }
    own = on & ~torqued & default & ~sent.any(axis=0)
    # In the step of the first torque it may still get a motor, as it does in turn with torques.
    torques = on & (joints.asked.torque_since < joints.step[:, None] - 1)
    planes = np.stack([own, torques], axis=2)
    where = planes | np.stack([sent, np.zeros_like(sent)], axis=2)
    return Match(
        where,
        np.zeros(where.shape),
        {"torque": TORQUE, "site": np.nan},
        {name: each[:, :, None] * planes for name, each in sums.items()},
        {"most": np.abs(joints.torque)},
        lasts={
            "sent": sent,
            "own": default,
            "limit": joints.limit,
            "motor_site": joints.asked.site,
            "inertia": joints.inertia,
            "torque_site": joints.asked.torque_site,
        },
        counts=planes.astype(np.int64),
    )


@default_motor.counts
def _(runs: Runs, _: Scene) -> Float64:
    holds = (runs.acting > MOVES * runs.inertia) & (runs.taken > HOLDS * runs.acting)
    asks = np.max([getattr(runs, name) for name in CAUSES], axis=0)
    asked = (asks > HOLDS * runs.acting) & (np.abs(runs.net) > SAME_SIGN * runs.acting)
    holds &= runs.torque | (asked & ~runs.sent)
    # Where torques are commanded, they are what the reader asks about; nothing is held where one
    # motor has to give way.
    torqued = np.isin(runs.keys[:, 0], runs.keys[holds & runs.torque, 0])
    weak = ~runs.torque & (runs.weak > LIMITED_OFTEN * runs.count)
    torqued |= np.isin(runs.keys[:, 0], runs.keys[weak, 0])
    return np.where(holds & (runs.torque | ~torqued), runs.taken, 0.0)


@default_motor.says
def _(worst: Worst) -> Said | None:
    term = max(CAUSES, key=lambda name: getattr(worst, name))
    commanded = any(worst.scene.inputs.commanded.values())
    if commanded and not worst.torque and term == "gravity":
        return None  # who commands others may want it to hold its weight
    ball = worst.subject.joints[worst.link].kind == "spherical"
    motor = Message("the velocity motor that PyBullet gives every joint")
    if ball:
        motor = Message("the position motor to 0 that PyBullet gives every ball joint")
    elif not worst.own:
        motor = Message(
            "the motor set at {site}, which still acts", site=worst.scene.site(worst.motor_site)
        )
    template = Message(
        "{joint} is held by {motor}: it takes {share:.0%} of what acts on it, mainly {term}, "
        "{given} of its {limit} on average"
    )
    if worst.torque:
        template = Message(
            "{joint} does not follow the torques that it is given, but is held by {motor}: it "
            "takes up to {most}, {share:.0%} of what acts on it"
        )
    share = min(worst.taken / worst.acting, 1.0)
    return Said(
        level="note" if commanded and not worst.torque else None,
        message=template,
        values={
            "motor": motor,
            "most": effort(worst.most, worst.effort),
            "given": effort(worst.taken / worst.time, worst.effort),
            "limit": effort(worst.limit, worst.effort),
            "share": share,
            "term": CAUSES[term],
        },
        advice=Message("turn it off: {call}"),
        cure=Cure("default-motor-off", worst.joint, form="ball" if ball else ""),
        proposed=not worst.torque,
        effect=Effect(worst.most, worst.effort),
        share=share,
        site=worst.scene.site(worst.torque_site),
    )

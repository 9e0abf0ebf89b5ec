"""Rules about calls that put a body elsewhere while it moves, and what they leave."""

from __future__ import annotations

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Effect
from drop_physics.rules.rule import Match, Said, Worst, body_rule, joint_rule
from drop_physics.rules.tables import BodyColumns, JointColumns
from drop_physics.rules.thresholds import KEPT, TELEPORTED_M_S, TURNS_RAD_S


@body_rule("teleported", "note")
def teleported(bodies: BodyColumns) -> Match | None:
    """A call puts a body elsewhere while it moves; a restored state is none of these."""
    if bodies.law.tree.fixed:
        return None
    way = np.linalg.norm(bodies.before.position_m - bodies.came("position_m"), axis=1)
    speed = np.linalg.norm(bodies.came("velocity")[:, 3:6], axis=1)
    where = bodies.put & (way > 0) & (speed > TELEPORTED_M_S)
    where &= ~bodies.scene.placing.restored(bodies.body, bodies.step)
    # Of all the first is told.
    return Match(where, np.ones(len(way)), {"way": way, "speed": speed})


@teleported.says
def _(worst: Worst) -> Said:
    more = Message(" (the first of {n:,} times)", n=worst.count) if worst.count > 1 else ""
    return Said(
        message=Message(
            "{body} is put {way:.3g} m away at step {step:,}{more}, while it moves at "
            "{speed:.3g} m/s: no force takes it there"
        ),
        values={"step": worst.first - 1, "more": more},
        effect=Effect(worst.way, "m"),
        share=0.0,
        site=worst.scene.placing.site(worst.subject, worst.last),
    )


@joint_rule("reset-leaves", "asked")
def rates_left(joints: JointColumns) -> Match | None:
    """`resetBasePositionAndOrientation` stops a base, and leaves the rates of its joints."""
    steps, number = joints.steps, np.full(len(joints.step), joints.body.number)
    if steps.law.tree.fixed:
        return None
    put = steps.put & joints.scene.placing.placed(number, joints.step)
    put &= (np.abs(steps.before.position_m - joints.came("position_m")) > KEPT).any(axis=1)
    put &= ~(np.abs(steps.before.joints - joints.came("joints")) > KEPT).any(axis=1)
    rates = np.abs(joints.rate_before)
    where = put[:, None] & (rates > TURNS_RAD_S)
    return Match(where, rates, {"sent": joints.target_velocity != 0})


@rates_left.says
def _(worst: Worst) -> Said:
    unit = f"{worst.unit}/s"
    return Said(
        level="note" if worst.sent else None,
        message=Message(
            "{joint} still turns at {rate:.3g} {unit} where a call puts {body}: it sets the base, "
            "and leaves the rates of joints"
        ),
        values={"rate": worst.size, "unit": unit},
        advice=Message("call p.resetJointState(body, joint, position, 0) for each, too"),
        effect=Effect(worst.size, unit),
        share=0.0,
        site=worst.scene.placing.site(worst.subject, worst.first),
    )

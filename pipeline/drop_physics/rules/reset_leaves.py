"""Rules about what a reset leaves unchanged: motor targets and joint velocities."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.messages import Message
from drop_physics.physics.vectors import lengths
from drop_physics.rules.engines import ANY, BULLETS, MUJOCOS
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.placing import Placing
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, Sized, body_rule, joint_rule
from drop_physics.rules.tables import BodyColumns, JointColumns
from drop_physics.rules.thresholds import (
    BACK,
    EACH_STEP,
    KEPT,
    MINOR,
    TELEPORTED_M_S,
    TURNS_RAD_S,
)
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body


@joint_rule("reset-leaves", "asked", consecutive=True, engines=ANY)
def reset_leaves(
    joints: JointColumns, inputs: Inputs, placing: Placing, last_samples: Mapping[int, int]
) -> Match | None:
    """A reset of positions leaves the targets of drives, which then move the joints away."""
    body, steps, before, told = joints.body, joints.steps, joints.before, joints.asked.told
    lasting = inputs.lasting
    writes = lasting.positions.get(body.client)
    # Written in each step, it is no reset.
    if writes is not None and len(writes.steps) >= EACH_STEP * last_samples[body.number]:
        return None
    step = np.broadcast_to(joints.step[:, None], before.shape).astype(np.float64)
    earlier = joints.earlier
    _, came = joints.latest(earlier.joints, np.ones(before.shape, np.bool_), joints.after)
    # A reset of the whole state resets targets, too.
    puts = (steps.put & ~np.isin(joints.step - 1, [*lasting.episodes[body.client]]))[:, None]
    puts = puts & (np.abs(before - came) > joints.at_target)
    episodes = puts | np.isnan(came)
    put, began = joints.latest(earlier.put_steps, episodes, step)
    position, home = joints.latest(earlier.put_joints, episodes, before)
    anew, back = told > began, np.abs(before - home) < BACK
    where = (told < put - 1) & (joints.limit > 0) & np.isfinite(joints.target)
    restored = placing.restored(body.number, joints.step)
    return Match(
        where,
        np.abs(position - joints.target) - np.abs(joints.after - joints.target),
        {"position": position, "target": joints.target, "least": joints.at_target + 0 * before},
        sums={"work": joints.torque * (joints.after - before)},
        firsts={"put": puts, "back": back, "restored": restored[:, None] & where, "anew": anew},
        begins=puts,
    )


@reset_leaves.counts
def _(
    put: Flags, until_work: Float64, size: Float64, least: Float64, back: Flags, keys: Int64
) -> Sized:
    # Motors that give the robot energy may take some of it at single joints. Of the joints that
    # they drove off, those that were put to their start come first.
    which = np.unique(keys[:, 0], return_inverse=True)[1]
    off = put & (np.bincount(which, until_work)[which] > 0) & (size >= least)
    return Sized(np.where(off, size, 0.0), graver=off & back)


@reset_leaves.notes
def _(restored: bool) -> Noted:
    return {"function": (Act.RESTORE if restored else Act.SET_JOINT).function}


KEPT_BY_MOTOR = SayingRow(
    says=Message(
        "{joint}{others} is reset to {position:at}, then driven {size:gap} away: its motor keeps "
        "the target of {target:at} that it had before"
    ),
    cure=Remedy("targets-held", "body", given={"function": "function"}),
    engines=BULLETS,
)
KEPT_IN_CTRL = SayingRow(
    says=Message(
        "{joint}{others} is put to {position:at} and driven off by {size:gap}: ctrl is still the "
        "{target:at} of before qpos was written"
    ),
    cure=Remedy("targets-held", "body"),
    proposed=True,
    engines=MUJOCOS,
)
# A target that was given once, before a reset to anywhere else, is meant; and one that is replaced
# before it drives the joint far does no harm. In ctrl, one that is sent again on purpose looks the
# same, as it does if the last episode began with it.
reset_leaves.rows(
    SayingRow(
        when=lambda back, size, target, position: back and size > MINOR * abs(target - position)
    ).like(KEPT_BY_MOTOR),
    SayingRow(level="note").like(KEPT_BY_MOTOR),
    SayingRow(when=lambda anew: anew, level="model").like(KEPT_IN_CTRL),
    SayingRow(level="note").like(KEPT_IN_CTRL),
    like=SayingRow(effect="size"),
)


# -- put-elsewhere --------------------------------------------------------------------------------


@body_rule("teleported", "note")
def teleported(bodies: BodyColumns, placing: Placing) -> Match | None:
    """A call changes the position of a moving body without restoring a saved state."""
    if bodies.law.tree.fixed:
        return None
    way = lengths(bodies.before.position_m - bodies.came(lambda states: states.position_m))
    speed = lengths(bodies.came(lambda states: states.velocity)[:, 3:6])
    where = bodies.put & (way > 0) & (speed > TELEPORTED_M_S)
    where &= ~placing.restored(bodies.body, bodies.step)
    # Of all the first is told.
    return Match(where, np.ones(len(way)), {"way": way, "speed": speed})


@teleported.notes
def _(placing: Placing, subject: Body, first: int, last: int, count: int) -> Noted:
    more = Message(" (the first of {n:,} times)", n=count) if count > 1 else ""
    return {"step": first - 1, "more": more, "called": placing.site(subject, last)}


teleported.rows(
    SayingRow(
        says=Message(
            "{body} is put {way:.3g} m away at step {step:,}{more}, while it moves at "
            "{speed:.3g} m/s: no force takes it there"
        ),
        effect="way",
        share=0.0,
        site="called",
    )
)


@joint_rule("reset-leaves", "asked")
def rates_left(joints: JointColumns, placing: Placing) -> Match | None:
    """`resetBasePositionAndOrientation` stops a base, but not its joints."""
    steps, number = joints.steps, np.full(len(joints.step), joints.body.number)
    if steps.law.tree.fixed:
        return None
    put = steps.put & placing.placed(number, joints.step)
    put &= (
        np.abs(steps.before.position_m - joints.came(lambda states: states.position_m)) > KEPT
    ).any(axis=1)
    put &= ~(np.abs(steps.before.joints - joints.came(lambda states: states.joints)) > KEPT).any(
        axis=1
    )
    rates = np.abs(joints.rate_before)
    where = put[:, None] & (rates > TURNS_RAD_S)
    return Match(where, rates, {"sent": joints.target_velocity != 0})


@rates_left.notes
def _(placing: Placing, subject: Body, first: int, unit: str) -> Noted:
    return {"unit": f"{unit}/s", "called": placing.site(subject, first)}


rates_left.rows(
    SayingRow(when=lambda sent: sent, level="note"),
    SayingRow(),
    like=SayingRow(
        says=Message(
            "{joint} still turns at {size:.3g} {unit} where a call puts {body}: it sets the base, "
            "and leaves the rates of joints"
        ),
        advice=Message("call p.resetJointState(body, joint, position, 0) for each, too"),
        effect="size",
        share=0.0,
        site="called",
    ),
)

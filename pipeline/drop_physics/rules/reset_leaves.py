"""Leftovers of calls that move a body: targets of motors, and rates of joints."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from drop_physics.messages import Message
from drop_physics.physics.vectors import lengths
from drop_physics.quantities import gap as distance
from drop_physics.quantities import place
from drop_physics.rules.answer import Cure, Effect, Level, Scene
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.rows import Said, Worst
from drop_physics.rules.rule import Match, Sized, body_rule, joint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import BodyColumns, JointColumns
from drop_physics.rules.thresholds import BACK, EACH_STEP, KEPT, TELEPORTED_M_S, TURNS_RAD_S
from drop_physics.trace.acts import Act


def left_targets(joints: JointColumns, anew: Collection[int] = ()) -> Match:
    """Return the joints that a call placed while they still have an earlier target.

    `anew`: the steps before which targets were set back, too.
    """
    steps, before, told = joints.steps, joints.before, joints.asked.told
    step = np.broadcast_to(joints.step[:, None], before.shape).astype(np.float64)
    came = joints.previous("reset-leaves after", joints.after)
    puts = (steps.put & ~np.isin(joints.step - 1, [*anew]))[:, None]
    puts = puts & (np.abs(before - came) > joints.at_target)
    episodes = puts | np.isnan(came)
    put = joints.latest("reset-leaves put", episodes, step)
    anew = told > joints.previous("reset-leaves began", put)
    position = joints.latest("reset-leaves position", episodes, before)
    back = np.abs(before - joints.previous("reset-leaves home", position)) < BACK
    where = (told < put - 1) & (joints.limit > 0) & np.isfinite(joints.target)
    restored = joints.scene.placing.restored(joints.body.number, joints.step)
    return Match(
        where,
        np.abs(position - joints.target) - np.abs(joints.after - joints.target),
        {"position": position, "target": joints.target, "least": joints.at_target + 0 * before},
        sums={"work": joints.torque * (joints.after - before)},
        firsts={"put": puts, "back": back, "restored": restored[:, None] & where, "anew": anew},
        begins=puts,
    )


def driven_off(runs: Runs, _: Scene) -> Sized:
    """Return the distance that motors drove joints; those set back to their start count first."""
    off = runs.put & (runs.until_work > 0) & (runs.size >= runs.least)
    return Sized(np.where(off, runs.size, 0.0), graver=off & runs.back)


def _said(worst: Worst, message: Message, cure: Cure, level: Level | None = None) -> Said:
    values = {
        "position": place(worst.position, worst.unit),
        "off": distance(worst.size, worst.unit),
        "target": place(worst.target, worst.unit),
        "count": worst.joints,
    }
    effect = Effect(worst.size, worst.unit)
    return Said(message=message, values=values, cure=cure, effect=effect, level=level)


@joint_rule("reset-leaves", "asked", consecutive=True)
def reset_leaves(joints: JointColumns) -> Match:
    """`resetJointState` and `restoreState` set positions and rates, and no motors."""
    return left_targets(joints)


@reset_leaves.says
def _(worst: Worst) -> Said:
    message = Message(
        "{joint} is reset to {position}, then driven {off} away: its motor keeps the target of "
        "{target} that it had before (joints of this robot: {count})"
    )
    function = (Act.RESTORE if worst.restored else Act.SET_JOINT).function
    cure = Cure("targets-held", worst.body, given={"function": function})
    # A target that was given once, before a reset to anywhere else, is meant.
    return _said(worst, message, cure, None if worst.back else "note")


@joint_rule("reset-leaves", "model", consecutive=True, engines=MUJOCOS)
def state_leaves_control(joints: JointColumns) -> Match | None:
    """Writing `qpos` sets positions, and not what actuators are given."""
    body, scene = joints.driven.body, joints.scene
    writes = scene.inputs.lasting.positions.get(body.client)
    # Written in each step, it is no reset.
    if writes is not None and len(writes.steps) >= EACH_STEP * scene.ends[body.number]:
        return None
    return left_targets(joints, scene.inputs.lasting.episodes[body.client])


@state_leaves_control.says
def _(worst: Worst) -> Said:
    message = Message(
        "{joint} is put to {position} and driven off by {off}: ctrl is still the {target} of "
        "before qpos was written (joints of this robot: {count})"
    )
    # Sent there again on purpose it looks the same, as it does if the last episode began with it.
    level: Level | None = None if worst.anew else "note"
    said = _said(worst, message, Cure("targets-held", worst.body), level)
    return replace(said, proposed=True)


for _rule in (reset_leaves, state_leaves_control):
    _rule.counts(driven_off)


# -- put-elsewhere --------------------------------------------------------------------------------


@body_rule("teleported", "note")
def teleported(bodies: BodyColumns) -> Match | None:
    """A call puts a body elsewhere while it moves; a restored state is none of these."""
    if bodies.law.tree.fixed:
        return None
    way = lengths(bodies.before.position_m - bodies.came(lambda states: states.position_m))
    speed = lengths(bodies.came(lambda states: states.velocity)[:, 3:6])
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
    put &= (
        np.abs(steps.before.position_m - joints.came(lambda states: states.position_m)) > KEPT
    ).any(axis=1)
    put &= ~(np.abs(steps.before.joints - joints.came(lambda states: states.joints)) > KEPT).any(
        axis=1
    )
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

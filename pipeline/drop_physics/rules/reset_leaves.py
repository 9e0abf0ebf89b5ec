"""The rule `reset-leaves`: targets, controls, forces and rates that a reset leaves or clears."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.driving import control_of
from drop_physics.messages import Message
from drop_physics.physics.vectors import lengths
from drop_physics.rules.answer import so_many
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import ANY, BULLETS, MUJOCOS
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.joint import name_of
from drop_physics.rules.placing import Placing
from drop_physics.rules.rows import Case, Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, Sized, actuator_rule, body_rule, input_rule, joint_rule
from drop_physics.rules.tables import ActuatorColumns, BodyColumns, JointColumns
from drop_physics.rules.thresholds import (
    BACK,
    EACH_STEP,
    KEPT,
    MINOR,
    TELEPORTED_M_S,
    TURNS_RAD_S,
    WATCHED,
)
from drop_physics.trace.acts import LOADS_KEYFRAME, Act
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.writes import written_by


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


@actuator_rule(
    "reset-leaves",
    "model",
    reason="reset-clears",
    least_count=WATCHED,
    consecutive=True,
    engines=MUJOCOS,
)
def reset_clears(actuators: ActuatorColumns, chunk: StepChunk) -> Match:
    """A reset of the state sets controls to zero, and nothing sets them again.

    An episode that begins with zeros like the previous one is not reported, since the script may
    have written them: a write is visible only if it changes a value.
    """
    given, before = actuators.given, actuators.before.copy()
    cleared, written = np.zeros(given.shape, np.bool_), dict[int, dict[int, float]]()
    kept = actuators.earlier.first_controls
    began = kept.get(actuators.number, given[0])
    resets = {call.at.step for call in chunk.piece.calls.of(Act.RESET_STATE)}
    for call in chunk.piece.calls.of(Act.SET_CONTROL, Act.RESET_STATE) if resets else ():
        if call.client != actuators.client or call.at.step not in resets:
            continue
        row = int(np.searchsorted(actuators.step, call.at.step + 1))
        there = row < len(given) and actuators.step[row] == call.at.step + 1
        rows, wrote = slice(row, row + there), written.setdefault(call.at.step, {})
        if call.act is Act.SET_CONTROL:
            indices, values, _ = written_by(call)
            wrote |= zip(indices.tolist(), values.tolist(), strict=True)
            continue
        for k, actuator in enumerate(actuators.actuators):
            before[rows, k] = wrote.get(actuator.number, before[rows, k])
            cleared[rows, k] = began[k] != 0 or actuator.number in wrote
        began = given[row] if there else began
    kept[actuators.number] = began
    cleared &= (before != 0) & (given == 0)
    return Match(given == 0, np.ones(given.shape), firsts={"was": before * cleared}, begins=cleared)


@reset_clears.counts
def _(was: Float64, size: Float64) -> Float64:
    return np.where(was != 0, size, 0.0)


reset_clears.rows(
    SayingRow(
        says=Message(
            "{name} is given 0 in {steps} after a reset, which clears ctrl: before it was {was:.4g}"
        ),
        cure=Remedy("targets-held", "body", form="reset"),
    )
)


@input_rule("reset-leaves", "model", "reset-clears", engines=MUJOCOS)
def reset_clears_force(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """A reset of the state sets forces to zero, and nothing sets them again."""
    for (client, act, place), force in inputs.lasting.forces.items():
        steps = seen.steps_of(client) - force.since
        by_reset = force.since in inputs.lasting.episodes[client] and not force.now.any()
        # A body may be pushed for a while; what is reset before a step never pushes it.
        is_drive = act is Act.SET_JOINT_FORCE and force.from_start
        is_lost = act is not Act.SET_ACTIVE and not force.acts
        if by_reset and (is_drive or is_lost) and steps >= WATCHED and not force.was_cleared:
            told = {"field": force.call.function, "name": f"{force.call.function}[{place}]"}
            told |= {"steps": so_many(steps), "was": force.most[np.abs(force.most).argmax()]}
            yield Case(call=force.call, values=told)


reset_clears_force.rows(
    SayingRow(
        says=Message(
            "{name} is given 0 in {steps} after a reset, which clears it: before it was {was:.4g}"
        ),
        advice=Message("data.{field}[:] = … after each reset"),
        share=1.0,
    )
)


@joint_rule("reset-leaves", "asked", engines=MUJOCOS)
def keyframe_without_control(joints: JointColumns, chunk: StepChunk) -> Match | None:
    """Writing a keyframe's `qpos` sets its pose, but not its `ctrl`."""
    body, steps = joints.driven.body, joints.driven.steps
    if steps.steps[0] != 1 or len(steps) < WATCHED or not (body.keyframes and body.actuators):
        return None
    given = [control_of(actuator, body, chunk.piece, steps.steps) for actuator in body.actuators]
    watched = np.array(given)[:, :WATCHED]
    begins, now = steps.before.joints[0], watched[:, 0]
    keys = [
        keyframe for keyframe in body.keyframes if np.abs(begins - keyframe.joints).max() < BACK
    ]
    calls = chunk.piece.calls.of(Act.RESET_STATE)
    loaded = any(call.function == LOADS_KEYFRAME and not call.at.step for call in calls)
    # Of poses that look the same, one may have what it gives; and what is loaded may be changed.
    same = any(np.abs(now - key.given).max() < BACK for key in keys)
    has_none = loaded and same and not now.any()
    if not keys or np.ptp(watched, axis=1).any() or ((loaded or same) and not has_none):
        return None
    servos = {actuator.target for actuator in body.actuators if actuator.kind == "position"}
    served = [name_of(joints.driven, k) in servos for k in range(len(joints.at_target))]
    off = np.abs(joints.after[WATCHED - 1] - joints.before[0])
    where = (np.arange(len(steps)) < WATCHED)[:, None] & served & (off > joints.at_target)
    given_now, given_there = (
        " ".join(f"{each:g}" for each in values) for values in (now, keys[0].given)
    )
    texts = {"key": keys[0].name, "now": given_now, "given": "" if has_none else given_there}
    numbers = {name: np.full(where.shape, text) for name, text in texts.items()}
    return Match(where, np.broadcast_to(off, where.shape), numbers)


keyframe_without_control.rows(
    SayingRow(
        when=lambda given: given,
        says=Message(
            "{body} begins in the pose of keyframe {key} and {joint} is driven off by {size:gap}: "
            "ctrl is {now}, and that of the keyframe is {given}"
        ),
        cure=Remedy("keyframe-ctrl", "body"),
        effect="size",
    ),
    SayingRow(
        says=Message(
            "{joint} is driven off the pose of keyframe {key} by {size:gap}: that keyframe gives "
            "each actuator 0"
        ),
        advice=Message('ctrl="…" of the <key>'),
        level="model",
        proposed=True,
        effect="size",
    ),
)


@joint_rule("reset-leaves", "note", reason="keyframe", engines=MUJOCOS)
def never_loaded(joints: JointColumns, chunk: StepChunk) -> Match | None:
    """A keyframe has controls, but the run starts from another pose, with controls of 0."""
    body, steps = joints.driven.body, joints.driven.steps
    keys = [keyframe for keyframe in body.keyframes if any(keyframe.given)]
    if not keys or not len(steps):
        return None
    given = [control_of(actuator, body, chunk.piece, steps.steps) for actuator in body.actuators]
    begins = steps.before.joints[0]
    at_key = any(np.abs(begins - keyframe.joints).max() < BACK for keyframe in body.keyframes)
    where = ~np.any(given, axis=0) & (not at_key or steps.steps[0] > 1)
    every = np.broadcast_to(where[:, None], joints.after.shape)
    return Match(every, np.ones(every.shape), {"key": np.full(every.shape, keys[0].name)})


@never_loaded.counts
def _(count: Int64, size: Float64, ends: Int64) -> Float64:
    return np.where(count == ends, size, 0.0)


never_loaded.rows(
    SayingRow(
        says=Message(
            "{body} is given 0 in all steps, and does not begin in the pose of keyframe {key}: a "
            "model does not load it by itself"
        ),
        advice=Message("mujoco.mj_resetDataKeyframe(…) before the first step"),
        share=0.0,
    )
)

"""Rules about MuJoCo keyframes whose pose, but not whose controls, a script uses."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.driving import control_of
from drop_physics.messages import Message
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import name_of
from drop_physics.rules.rows import Remedy, SayingRow
from drop_physics.rules.rule import Match, joint_rule
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import BACK, WATCHED
from drop_physics.trace.acts import LOADS_KEYFRAME, Act


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

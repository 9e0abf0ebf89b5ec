"""Sends imported states as if a recorded script had produced them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np

from drop_physics.engines.mujoco import memory
from drop_physics.engines.mujoco.frames import (
    APART,
    CAUSES,
    NEAR,
    PARTS,
    STEP,
    STEP_HEAD,
    USER,
    WRITTEN,
    WRITTEN_HEAD,
    arrays_bytes,
    kind_of,
    note_bytes,
    part_bytes,
)
from drop_physics.engines.mujoco.importing.steps import ImportedStep, ImportedSteps

PIECE_BYTES = 1 << 20
FIRST, IMPORTED = CAUSES.index("first"), CAUSES.index("imported")


def stream_of(
    steps: ImportedSteps, tell: Callable[[ImportedStep], None], *, stepped: bool
) -> Iterator[bytes]:
    """Yield imported states as messages, in the format of a script's process.

    Parameters
    ----------
    steps
        MuJoCo's steps from the recorded states.
    tell
        A function that is called with each step.
    stepped
        Whether consecutive states are one timestep apart; otherwise no steps are made.
    """
    m, states = steps.m, steps.states
    data = mujoco.MjData(m)
    core = memory.core_of(data)
    yield note_bytes("mujoco", version=mujoco.__version__, python="")
    yield from _model(m)
    yield note_bytes(
        "world",
        number=0,
        model=0,
        core=[(part.name, part.begin, part.size) for part in core.parts],
        user=[(part.name, part.begin, part.size) for part in memory.user_of(data).parts],
        core_bytes=core.size,
        apart_s=None if stepped else states.step_s,
    )
    data.qpos[:], data.qvel[:] = states.parts["qpos"][0], states.parts["qvel"][0]
    if "act" in states.parts:
        data.act[:] = states.parts["act"][0]
    yield _written(FIRST, core.parts, states.times_s[0])
    sent: dict[str, bytes] = {}
    taken = iter(steps)
    for number in range(len(states) - 1):
        flag = APART
        if stepped:
            step = next(taken)
            tell(step)
            yield from _inputs(steps, step, sent)
            data.qacc_warmstart[:] = step.warmstart
            flag = NEAR if step.near else APART
        for name in ("qpos", "qvel", "act"):
            if name in states.parts:
                getattr(data, name)[:] = states.parts[name][number + 1]
        time_s = states.times_s[number + 1]
        yield STEP_HEAD.pack(STEP, flag, 0, 0, 0, time_s) + core.view.tobytes()


def _model(m: Any) -> Iterator[bytes]:  # noqa: ANN401 - an MjModel
    binary = np.empty(mujoco.mj_sizeModel(m), np.uint8)
    mujoco.mj_saveModel(m, None, binary)
    digest = hashlib.sha256(binary.data).hexdigest()
    fields = [[f.name, f.dtype.str, f.shape] for f in memory.fields_of(m)]
    yield note_bytes("model", number=0, digest=digest, fields=fields)
    yield arrays_bytes("constants", memory.constants_of(m), digest=digest)
    for at in range(0, len(binary), PIECE_BYTES):
        yield arrays_bytes("binary", {"bytes": binary[at : at + PIECE_BYTES]}, digest=digest)


def _inputs(steps: ImportedSteps, step: ImportedStep, sent: dict[str, bytes]) -> Iterator[bytes]:
    """Yield the inputs of a step that differ from those last sent."""
    parts = b""
    count = 0
    for name in USER:
        if name == "ctrl":
            row: Any = step.given
        elif name in steps.states.parts:
            row = steps.states.parts[name][step.number]
        else:
            continue
        now = np.ascontiguousarray(row, kind_of(name)).tobytes()
        before = sent.get(name)
        if now and now != before:
            parts += part_bytes(PARTS.index(name), before or bytes(len(now)), now)
            count += 1
            sent[name] = now
    if count:
        yield WRITTEN_HEAD.pack(WRITTEN, IMPORTED, count, 0, 0, 0, np.nan) + parts


def _written(cause: int, parts: Any, time_s: float) -> bytes:  # noqa: ANN401
    """Pack a whole state as a message."""
    frames = [part_bytes(part.number, b"\xff" * part.size, part.view) for part in parts]
    return WRITTEN_HEAD.pack(WRITTEN, cause, len(frames), 0, 0, 0, time_s) + b"".join(frames)

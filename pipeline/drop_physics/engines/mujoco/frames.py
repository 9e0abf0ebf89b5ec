"""Binary format in which a MuJoCo script's process sends its states, written and read here.

Two processes use this file: the script's own (`watch`), which may run an older Python without
drop's packages, and the process that reads the stream. `explain` replays the frames, and answers
with `ARRAYS` payloads.

Every payload begins with one letter:

NOTE      JSON, with `what`
ARRAYS    named arrays: length of a JSON head, the head, which ends with
          `"arrays": [[name, dtype, shape], …]`, and the numbers of each array in turn
STEP      `STEP_HEAD` and the core of the state after a step, as it lies in memory
WRITTEN   `WRITTEN_HEAD` and the parts of a state that are not what the last step left
EDITED    `EDITED_HEAD` and the elements of a model's array that were changed in place
DONE      `DONE_HEAD`: a call that resets, or makes data current, was made
CALLBACK  `CALLBACK_HEAD` and what the script's callbacks did within the step that follows
WARNED    `WARNED_HEAD` and MuJoCo's counters of warnings, as they were after the step before

A part of a state is `PART_HEAD`, the indices (uint32) if not all elements are sent, and the values.
"""

from __future__ import annotations

import json
import math
from struct import Struct
from typing import Any, NamedTuple

import numpy as np

NOTE, ARRAYS, STEP, WRITTEN = b"N", b"A", b"S", b"W"
EDITED, DONE, CALLBACK, WARNED = b"E", b"D", b"C", b"!"

LENGTH = Struct("<I")
"""Header with the length of a request's or an answer's payload."""
STEP_HEAD = Struct("<cBHIId")
"""STEP, step function (`STEPS`), 0, index of the simulation, site, time after the step [s]."""
WRITTEN_HEAD = Struct("<cBHIIid")
"""WRITTEN, cause (`CAUSES`), number of parts, simulation, site, argument of a call, time [s]."""
EDITED_HEAD = Struct("<cBHIIII")
"""EDITED, 0, number of the field, number of the model, simulation whose step detected the edit,
site, number of elements.

The indices into the flat array (uint32) and the new values follow."""
DONE_HEAD = Struct("<cBHIIi")
"""DONE, function (`CAUSES`), 0, simulation, site, argument."""
CALLBACK_HEAD = Struct("<cBHII")
"""CALLBACK, 0, 0, simulation, number of calls; each is one byte (`CALLBACKS`), then its effect."""
WARNED_HEAD = Struct("<cBHI")
"""WARNED, 1 if the step went back in time, 0, simulation; followed by pairs of int32, last info and
count of each warning."""
PART_HEAD = Struct("<BBHI")
"""Index of the part (`PARTS`), 1 if indices follow, 0, number of elements."""

STEPS = ("mj_step", "mj_step2", "mj_Euler", "mj_implicit", "mj_RungeKutta")
"""Functions that make a step, by index."""
STALE = 1 << 6
"""Flag added to the number of a step function: the step's positions were computed from another
state, which the WRITTEN message just before sent as the parts of "posed"."""
UNPOSED = 1 << 7
"""Flag added to the number of a step function: the step's positions are those of the state before
the previous step."""

NEAR, APART = 1 << 4, 1 << 5
"""Flags added to the number of a step function if another program made and recorded the step. NEAR:
MuJoCo's own step from the same state leads to the recorded state within rounding. APART: it leads
to another state."""

READS = (
    *("mj_jac", "mj_jacBody", "mj_jacBodyCom", "mj_jacSubtreeCom", "mj_jacGeom", "mj_jacSite"),
    *("mj_jacPointAxis", "mj_jacDot"),
)
"""Functions that read values computed from positions."""
CAUSES = (
    "memory",
    "posed",
    "first",
    "step",
    "imported",
    "mj_resetData",
    "mj_resetDataKeyframe",
    "mj_resetDataDebug",
    "mj_setState",
    "mj_copyState",
    "mj_copyData",
    "mj_setConst",
    "picture",
    "mj_forward",
    "mj_step1",
    "mj_inverse",
    "mj_kinematics",
    "mj_fwdPosition",
    "mj_fwdKinematics",
    "mj_forwardSkip",
    *READS,
)
"""Origins of a recorded state: the script's own writes; no change (the state from which derived
data were computed, or the first observed state); the previous step, within which MuJoCo reset the
simulation; another program, whose states are imported; a rendered image, with the image's digest as
argument; or a function. Functions from `mj_forward` on were called by the script right after its
own writes."""
CALLBACKS = ("control", "passive", "act_dyn", "act_gain", "act_bias", "contactfilter", "sensor")

CORE = ("qpos", "qvel", "act", "history", "plastic", "qacc_warmstart", "plugin_state")
"""Fields that a step changes, in the order of MuJoCo's memory."""
USER = ("ctrl", "qfrc_applied", "xfrc_applied", "eq_active", "mocap_pos", "mocap_quat")
"""Names of the state parts that only the script changes, in the order of MuJoCo's memory."""
CLOCK = "clock_s"
"""The name of MuJoCo's own clock as a part of the state."""
ASLEEP = "tree_asleep"
"""State part with the number of steps for which each tree has been still or, for a sleeping tree,
the next tree that sleeps with it. A step reads and changes it. MuJoCo before 3.4 has none."""
PARTS = (*CORE, *USER, ASLEEP)
STATE = (*CORE, ASLEEP)
"""Parts of the state that a step changes, and that the next one needs."""
KINDS: dict[str, np.dtype[Any]] = {"eq_active": np.dtype(np.uint8), ASLEEP: np.dtype(np.int32)}
"""Types of the parts whose elements are not doubles."""
DOUBLE = np.dtype(np.float64)
LARGEST = 1e10
"""The largest number with which MuJoCo continues (`mjMAXVAL`): beyond it, MuJoCo resets itself."""
LONG = 32
"""A part with more elements is sent as indices and values if fewer than half have changed."""


def kind_of(name: str) -> np.dtype[Any]:
    """Return the numpy type of a state array, such as `qpos`, by name."""
    return KINDS.get(name, DOUBLE)


def part_bytes(number: int, before: bytes | memoryview, now: bytes | memoryview) -> bytes:
    """Pack the changed elements of a state array, such as `qpos`."""
    dtype = kind_of(PARTS[number])
    new = np.frombuffer(now, dtype)
    if len(new) > LONG:
        bits = f"u{dtype.itemsize}"
        changed = np.flatnonzero(np.frombuffer(before, bits) != new.view(bits))
        if 2 * len(changed) < len(new):
            indices = changed.astype(np.uint32)
            return (
                PART_HEAD.pack(number, 1, 0, len(changed))
                + indices.tobytes()
                + new[changed].tobytes()
            )
    return PART_HEAD.pack(number, 0, 0, len(new)) + bytes(now)


def part_of(payload: bytes, at: int) -> tuple[str, Any, Any, int]:
    """Unpack a state array: name, indices (None if whole), values, and the offset after it."""
    number, sparse, _, count = PART_HEAD.unpack_from(payload, at)
    at += PART_HEAD.size
    indices = None
    if sparse:
        indices = np.frombuffer(payload, np.uint32, count, at)
        at += 4 * count
    name = PARTS[number]
    dtype = kind_of(name)
    values = np.frombuffer(payload, dtype, count, at)
    return name, indices, values, at + count * dtype.itemsize


def note_bytes(what: str, **values: Any) -> bytes:
    """Return a JSON message as a payload."""
    return NOTE + json.dumps({"what": what, **values}).encode("utf-8", "replace")


def arrays_bytes(what: str, arrays: dict[str, Any], **values: Any) -> bytes:
    """Pack named arrays into a payload."""
    held = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    listed = [[name, array.dtype.str, array.shape] for name, array in held.items()]
    head = json.dumps({"what": what, **values, "arrays": listed}).encode("utf-8", "replace")
    parts = [ARRAYS, len(head).to_bytes(4, "little"), head]
    return b"".join([*parts, *(array.tobytes() for array in held.values())])


class ArrayPlace(NamedTuple):
    """The location of an array in a payload."""

    dtype: Any
    shape: tuple[int, ...]
    size: int
    """Number of elements."""
    begin: int
    """Offset of the first byte."""

    def of(self, payload: bytes) -> Any:
        """Return the array in a payload."""
        return np.frombuffer(payload, self.dtype, self.size, self.begin).reshape(self.shape)


def places_of(payload: bytes) -> tuple[dict[str, Any], dict[str, ArrayPlace]]:
    """Return an ARRAYS payload's JSON head, without `arrays`, and the locations of the arrays."""
    length = int.from_bytes(payload[1:5], "little")
    head = json.loads(payload[5 : 5 + length])
    at, places = 5 + length, {}
    for name, kind, shape in head.pop("arrays"):
        dtype, size = np.dtype(kind), math.prod(shape)
        places[name] = ArrayPlace(dtype, tuple(shape), size, at)
        at += size * dtype.itemsize
    return head, places


def arrays_of(payload: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the JSON head of an ARRAYS payload, without `arrays`, and the arrays by name."""
    head, places = places_of(payload)
    return head, {name: place.of(payload) for name, place in places.items()}

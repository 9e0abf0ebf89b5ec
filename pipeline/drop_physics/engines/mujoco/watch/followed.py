"""Compares a script's MjModel and MjData with the values last sent, and sends what changed."""

from __future__ import annotations

import hashlib
import struct
import weakref
from typing import TYPE_CHECKING, Any

import numpy as np

from ...watching.pipe import ANSWERS, EXTREMES, MUJOCO, PLACES
from .. import memory
from ..frames import (
    CALLBACK,
    CALLBACK_HEAD,
    CAUSES,
    DONE,
    DONE_HEAD,
    EDITED,
    EDITED_HEAD,
    STALE,
    STEP,
    STEP_HEAD,
    UNPOSED,
    WARNED,
    WARNED_HEAD,
    WRITTEN,
    WRITTEN_HEAD,
    arrays_bytes,
    note_bytes,
    part_bytes,
)

if TYPE_CHECKING:
    from .hooks import MujocoWatch

PIECE_BYTES = 1 << 20
"""Chunk size in which a model's binary form is sent [bytes]."""
MOVING = ("qpos", "qvel")
EMPTIES = ("mj_resetData", "mj_resetDataKeyframe", "mj_resetDataDebug", "mj_setState")
"""Functions that set positions, and compute nothing from them."""
IDLE_CALLS = 10
"""Number of `mj_forward` calls after which a script without steps counts as waiting for motion."""
MEMORY, POSED, FIRST, RESET = map(CAUSES.index, ("memory", "posed", "first", "step"))
FRAME = struct.Struct("<cI" + STEP_HEAD.format[1:])
"""Header of a step's frame: that of the frame, then that of the step."""


class WatchedModel:
    """A script's MjModel, compared with the values last sent to find edits.

    Parameters
    ----------
    watch
        The watch that sends the messages.
    m
        The MjModel; nothing here keeps it alive.
    number
        The model's number in the stream.
    """

    def __init__(self, watch: MujocoWatch, m: Any, number: int) -> None:
        self.watch, self.number, self.ref = watch, number, weakref.ref(m)
        self.fields = memory.fields_of(m)
        stretches = memory.stretches_of(self.fields)
        self.pairs = [(saved, view) for saved, view, _ in stretches]
        """Pairs of the values last sent and the current ones."""
        self._begins = [begin for _, _, begin in stretches]
        self._tell(m)

    def _tell(self, m: Any) -> None:
        """Send the model: its digest, the constants for the analysis, and its bytes if new."""
        binary = np.empty(self.watch.mujoco.mj_sizeModel(m), np.uint8)
        self.watch.mujoco.mj_saveModel(m, None, binary)
        digest = hashlib.sha256(binary.data).hexdigest()
        send, known = self.watch.send, digest in self.watch.digests
        send(
            note_bytes(
                "model",
                number=self.number,
                digest=digest,
                bytes=len(binary),
                known=known,
                fields=[[f.name, f.dtype.str, f.shape] for f in self.fields],
            )
        )
        if known:
            return
        self.watch.digests.add(digest)
        send(arrays_bytes("constants", memory.constants_of(m), digest=digest))
        for at in range(0, len(binary), PIECE_BYTES):
            piece = binary[at : at + PIECE_BYTES]
            send(arrays_bytes("binary", {"bytes": piece}, digest=digest, at=at))

    def tell_edits(self, world: int, site: int) -> None:
        """Send what the script changed in the model since the last comparison."""
        for (saved, view), begin in zip(self.pairs, self._begins):
            if saved == view:
                continue
            end = begin + len(saved)
            for number, field in enumerate(self.fields):
                if not begin <= field.address < end:
                    continue
                at = field.address - begin
                now = np.frombuffer(view[at : at + field.size], field.dtype)
                raw = np.frombuffer(view[at : at + field.size], np.uint8)
                old = np.frombuffer(saved, np.uint8, field.size, at)
                changed = (raw != old).reshape(-1, field.dtype.itemsize).any(axis=1)
                if changed.any():
                    indices = np.flatnonzero(changed).astype(np.uint32)
                    head = EDITED_HEAD.pack(
                        EDITED, 0, number, self.number, world, site, len(indices)
                    )
                    self.watch.send(head + indices.tobytes() + now[changed].tobytes())
            saved[:] = view


class SensorExtremes:
    """The first, last, least and greatest reading of each sensor, tendon and actuator.

    Readings of sensors come first, then the tendons' lengths, then the actuators' lengths and
    forces. They lie in memory shared with the recorder, so a crash loses none.
    """

    @staticmethod
    def of(watch: MujocoWatch, d: Any) -> SensorExtremes | None:
        """Create the record of extremes for an MjData; None without readings or shared memory."""
        numbers = d.sensordata, d.ten_length, d.actuator_length, d.actuator_force
        read = [each for each in numbers if each.size]
        size = EXTREMES * sum(each.size for each in read)
        begin = PLACES * ANSWERS * EXTREMES - watch.sensed - size  # from behind
        if not size or begin < 0 or not watch.pipe.open:
            return None
        watch.sensed += size
        views = [memory.view_of(each.ctypes.data, each.nbytes) for each in read]
        return SensorExtremes(watch.pipe.answers[begin : begin + size], views, begin)

    def __init__(self, kept: Any, views: list[memoryview], begin: int) -> None:
        rows = np.frombuffer(kept).reshape(EXTREMES, -1)
        self._first, self._last, self._least, self._greatest = rows
        ends = np.cumsum([0, *(view.nbytes for view in views)]).tolist()
        last = self._last.data.cast("B")
        self._read = [(last[a:b], view) for a, b, view in zip(ends, ends[1:], views)]
        """Pairs of memory for each sensor: of the last reading, and of the current one."""
        self._is_first = True
        self.place = begin, rows.shape[1]
        """Index of the first extreme in the shared memory, and the number of readings."""

    def add(self) -> None:
        """Update the extremes with the readings after a step."""
        last, least, greatest = self._last, self._least, self._greatest
        for kept, now in self._read:
            kept[:] = now
        if self._is_first:
            self._first[:] = least[:] = greatest[:] = last
            self._is_first = False
        _fmin(least, last, least)
        _fmax(greatest, last, greatest)


_fmin, _fmax = np.fmin, np.fmax


class WatchedData:
    """A script's MjData, whose steps and writes are sent.

    Parameters
    ----------
    watch
        The watch that sends the messages.
    model
        The model with which the MjData was last stepped.
    d
        The MjData; nothing here keeps it alive.
    number
        The simulation's number in the stream.
    site
        The call site at which the MjData was first observed.
    """

    def __init__(
        self, watch: MujocoWatch, model: WatchedModel, d: Any, number: int, site: int
    ) -> None:
        self.watch, self.model, self.number, self.ref = watch, model, number, weakref.ref(d)
        self.core, self.user = memory.core_of(d), memory.user_of(d)
        self.asleep = memory.asleep_of(d)
        self._stretches = self.core, self.user, self.asleep
        self.warned = memory.warnings_of(d)
        self._warnings = bytearray(self.warned)
        self._passive = memory.view_of(d.qfrc_passive.ctypes.data, d.qfrc_passive.nbytes)
        self._sensed = SensorExtremes.of(watch, d)
        self.uses = watch.uses_of(d)
        self.uses.follow(self)
        self.lost = False
        """Whether the simulation is no longer followed, because of an error."""
        self.time = self.elapsed_s = 0.0
        self.answers: list[bytes] = []
        """Effects of callbacks within the current step."""
        self._calling = bytearray()
        self._idle = 0
        """Number of consecutive times that derived data were recomputed while positions and
        velocities stayed."""
        self._posed: tuple[bytes, bytes] | None = None
        """The state (core and user part) from which positions were computed; None for the state
        before the last step."""
        core, user, asleep = (
            [[part.name, part.begin, part.size] for part in stretch.parts]
            for stretch in self._stretches
        )
        watch.send(
            note_bytes(
                "world",
                number=number,
                model=model.number,
                core=core,
                user=[*user, *asleep],
                core_bytes=self.core.size,
                sensed=None if self._sensed is None else self._sensed.place,
            )
        )
        self.tell_written(d, site, FIRST)

    @property
    def is_written(self) -> bool:
        """True if the script changed the state, apart from the time, since the last message."""
        return any(stretch.saved != stretch.view for stretch in self._stretches)

    def before(self, d: Any, site: int) -> None:
        """Send what the script wrote into state and model since the last step."""
        for saved, view in self.model.pairs:
            if saved != view:
                self.model.tell_edits(self.number, site)
                break
        core, user = self.core, self.user
        if core.saved != core.view or user.saved != user.view or d.time != self.time:
            self.tell_written(d, site, MEMORY)

    def elapse(self, d: Any) -> None:
        """Note the simulated time after a step of a trial run, which sends no steps."""
        time = d.time
        self.elapsed_s += max(time - self.time, 0.0)
        self.time = time

    def tell_written(self, d: Any, site: int, cause: int, argument: int = 0) -> None:
        """Send state arrays that something other than a step changed."""
        count, parts = 0, b""
        for stretch in self._stretches:
            if stretch.saved != stretch.view:
                more, frames = stretch.changed()
                count, parts = count + more, parts + frames
        self.time = d.time
        head = WRITTEN_HEAD.pack(WRITTEN, cause, count, self.number, site, argument, self.time)
        self.watch.send(head + parts)

    def pose(self, d: Any, site: int, cause: int, complete: bool) -> None:
        """Send the script's writes before derived data are recomputed, and note the state used."""
        if not self.elapsed_s:
            self._count_idle()
        if self.is_written:
            self.tell_written(d, site, cause)
        if complete:
            self._posed = bytes(self.core.view), bytes(self.user.view)

    def read(self, d: Any, site: int, cause: int) -> None:
        """Send the script's writes before a function reads derived data that are out of date."""
        for qpos in self.core.parts[:1]:
            if self.core.saved[qpos.begin : qpos.end] != qpos.view:
                self.tell_written(d, site, cause)

    def _count_idle(self) -> None:
        """Report once that a loop recomputes derived data while positions and velocities stay.

        A script whose state changes after the first such call is not waiting for a step: it is
        never reported.
        """
        core, still = self.core, self._idle + 1
        moving = (part for part in core.parts if part.name in MOVING)
        same = all(core.saved[part.begin : part.end] == part.view for part in moving)
        self._idle = still if same or still == 1 else -(1 << 62)
        if same and still == IDLE_CALLS:
            self.watch.send(note_bytes("idle", world=self.number))

    def set_by(self, d: Any, site: int, cause: int, argument: int) -> None:
        """Send the state that a function set (a reset, say), even if nothing changed."""
        if self.is_written or d.time != self.time:
            self.tell_written(d, site, cause, argument)
        else:
            head = DONE_HEAD.pack(DONE, cause, 0, self.number, site, argument)
            self.watch.send(head)
        self._posed = None
        self.uses.is_reset = CAUSES[cause] in EMPTIES

    def drawn(self, site: int, cause: int, digest: int) -> None:
        """Send the digest of an image that shows the state."""
        self.watch.send(DONE_HEAD.pack(DONE, cause, 0, self.number, site, digest))

    def staleness(self, everything: bool) -> int:
        """Send the state behind a step's derived data if it differs from the current state.

        With `everything`, all state arrays are compared; otherwise only those used in computing
        positions, velocities and constraints. Returns the flags of the step: `STALE`, `UNPOSED` or
        0.
        """
        posed, self._posed = self._posed, None
        if posed is None:
            return UNPOSED
        parts, count = b"", 0
        for stretch, held in zip((self.core, self.user), posed):
            for part in stretch.parts:
                before = held[part.begin : part.end]
                if (everything or part.name in _POSING) and before != bytes(part.view):
                    parts += part_bytes(part.number, part.view, before)
                    count += 1
        if not count:
            return 0
        head = WRITTEN_HEAD.pack(WRITTEN, POSED, count, self.number, 0, 0, self.time)
        self.watch.send(head + parts)
        return STALE

    def after(self, d: Any, site: int, function: int) -> None:
        """Send a step and the state after it."""
        core, time, pipe = self.core, d.time, self.watch.pipe
        reset = self.user.saved != self.user.view  # by a callback, or because MuJoCo has reset
        if self.answers:
            self._tell_answers()
            self.user.kept[:] = self.user.view
            reset = False
        dt, before = time - self.time, self.time
        if dt > 0.0:
            self.elapsed_s += dt
        self.time = time
        size = core.size
        if size < PLAIN:
            end = pipe.end if pipe.end <= pipe.limit else pipe.make_room(FRAME.size + size)
            FRAME.pack_into(
                pipe.memory,
                end,
                MUJOCO,
                STEP_HEAD.size + size,
                STEP,
                function,
                0,
                self.number,
                site,
                time,
            )
            end += FRAME.size
            pipe.memory[end : end + size] = core.view
            pipe.sent(end + size)
        else:
            head = STEP_HEAD.pack(STEP, function, 0, self.number, site, time)
            self.watch.send(head + bytes(core.view))
        core.kept[:] = core.view
        self._posed = None
        if self._sensed is not None:
            self._sensed.add()
        if self.uses.read or self.uses.forces or self.uses.is_reset:
            self.uses.after(step=True)
        if reset or self.asleep.saved != self.asleep.view:
            self.tell_written(d, site, RESET)
        # MuJoCo clears the counters where it resets itself: then they may be what they were.
        if self._warnings != self.warned or time <= before:
            self._warnings[:] = self.warned
            head = WARNED_HEAD.pack(WARNED, time <= before, 0, self.number)
            self.watch.send(head + bytes(self.warned))

    # -- what callbacks do within a step ----------------------------------------------------------

    def begin_calling(self) -> None:
        """Start noting what callbacks return or write during a step."""
        self._calling[:] = self.user.saved

    def called(self, which: int, answer: float | None) -> None:
        """Note what a callback returned or wrote."""
        head = bytes((which,))
        if answer is not None:
            self.answers.append(head + struct.pack("<d", answer))
            return
        user, calling = self.user, memoryview(self._calling)
        parts, count = b"", 0
        for part in user.parts:
            before = calling[part.begin : part.end]
            now = user.view[part.begin : part.end]
            if bytes(before) != bytes(now):
                parts += part_bytes(part.number, before, now)
                count += 1
        self._calling[:] = user.view
        passive = bytes(self._passive) if which == _PASSIVE else b""
        self.answers.append(head + bytes((count,)) + parts + passive)

    def _tell_answers(self) -> None:
        head = CALLBACK_HEAD.pack(CALLBACK, 0, 0, self.number, len(self.answers))
        self.watch.send(head + b"".join(self.answers))
        self.answers = []


PLAIN = 1 << 18
"""Core states up to this size [bytes] are written directly into the shared memory block, of which
one takes at most a quarter."""
_POSING = ("qpos", "qvel", "act", "mocap_pos", "mocap_quat", "eq_active")
"""Inputs used in computing positions, velocities and constraints."""
_PASSIVE = 1
"""Index of the callback that adds passive forces."""

"""Sends frames from the script's process to the recorder, through a pipe.

A stream begins with `MAGIC`. Each frame is a kind (one letter), the length of its payload (uint32,
little-endian), and the payload. A stream may end at any byte: an incomplete frame is dropped.

Frames are collected in a block of shared memory, and sent in large writes. Nothing is lost when a
process crashes or is killed, since the recorder then reads the rest of the block.
"""

from __future__ import annotations

import ctypes
import json
import mmap
import os
import struct
import time
from os import close, fstat, write
from typing import Any

MAGIC = b"DROPREC\x02"
"""First bytes of a stream; the last byte is the format's version, since both processes must use the
same version of drop."""
HEADER = struct.Struct("<cI")
"""Header of a frame: kind and length."""

NOTE, SAMPLE, SET, CALL, RESULT, IMAGE = b"J", b"S", b"P", b"K", b"R", b"I"
MUJOCO = b"M"
"""Kinds of frames: NOTE is JSON, MUJOCO has the format of `engines/mujoco/frames`; the others are
doubles after a small header.

SAMPLE: for each body of the last layout message, 13 numbers of the base if it can move, then
positions, velocities and efforts of the joints; then the forces of the constraints, and 23 numbers
of each contact point. SET: the same numbers of one body. CALL: the numbers in the arguments of a
call. RESULT: the number that the last call returned. IMAGE: JSON, then pixels.
"""
HEAD = struct.Struct("<qq")
"""Header of samples and states set by calls: index of the world or body, and step."""
CALL_HEAD = struct.Struct("<II")
"""Header of a call: indices of the world and of the site."""
NUMBER = struct.Struct("<d")
IMAGE_HEAD = struct.Struct("<I")
"""Header of an image: length of the JSON before its pixels."""

BLOCK = struct.Struct("=QQ")
"""Header of the block: number of bytes sent so far, and number of bytes now in the block."""
BLOCK_BYTES = 1 << 20
PLACES, COUNTERS = 1 << 12, 4
"""Largest number of reading lines, and the number of 64-bit integers for each, which follow the
block: count of readings; whether some may be missing; the last step with a reading; how many
numbers a reading returns."""
ANSWERS, EXTREMES = 10, 4
"""Largest number of values that are kept of a reading's return value, and how many are kept of each
value: the first, the last, the least and the greatest."""
MOST_TARGETS = 1024
"""Largest number of bodies, links or pairs listed for a reading line."""
APART = PLACES * COUNTERS
"""Offset of a flag that is set if any forked child makes a step, which is all that is recorded of a
child."""
ANSWERED = APART + 1
"""Offset of the return values of each reading line, as doubles."""
SHARED_BYTES = BLOCK_BYTES + 8 * (ANSWERED + PLACES * ANSWERS * EXTREMES)
CUT_BYTES = 64
"""Bytes reserved in the block for the message that the block is full after the pipe was closed."""
LONGEST = 1 << 29
"""Upper bound for the length of a payload; any four letters misread as a length exceed it."""
FLUSH_BYTES = 1 << 16
"""Fill level above which the block is sent before more is added."""
SHORT_BYTES = 1 << 14
"""Upper bound for the size of messages that are sent at every call [bytes]."""
FLUSH_S = 0.25


READ_WRITE, SHARED_FIXED = 1 | 2, 0x01 | 0x10
"""Flags of `mmap`, the same on Linux and macOS."""
MMAP: Any = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
"""Arguments for the memory mapping."""


class Pipe:
    """The sending end of the stream.

    Code that sends at every call writes to `memory` at `end`, after `make_room` if `end` is beyond
    `limit`, and then updates `end` as `sent` does. With `again`, an earlier program of the same
    process has already used the pipe and the block.
    """

    def __init__(self, pipe: int, block: int, *, again: bool = False) -> None:
        self._pipe = pipe
        self._inode = os.fstat(pipe).st_ino
        self.inode_of_block = os.fstat(block).st_ino
        self.memory: Any = mmap.mmap(block, SHARED_BYTES)
        self.counters: Any = memoryview(self.memory)[BLOCK_BYTES:].cast("Q")
        self.answers: Any = memoryview(self.memory)[BLOCK_BYTES + 8 * ANSWERED :].cast("d")
        self.counts: Any = memoryview(self.memory)[: BLOCK.size].cast("Q")
        os.set_inheritable(pipe, False)
        os.close(block)
        self._before = self.counts[0] if again else 0
        self.end, self.limit = BLOCK.size, BLOCK.size + FLUSH_BYTES
        self._flushed_at = _now()
        self.open = True
        self.gone = False
        """Whether the recorder has closed its end of the pipe."""
        self.muted = False
        """Whether only JSON messages are sent."""
        self._closed = False
        """Whether the script has closed the pipe: further frames go to the block as long as they
        fit."""
        if again:
            self.memory[BLOCK_BYTES:] = bytes(SHARED_BYTES - BLOCK_BYTES)
        else:
            self.write(MAGIC)
        self.flush()

    def hand_on(self) -> None:
        """Leave the pipe open for the program that replaces this process."""
        os.set_inheritable(self._pipe, True)

    def note(self, what: str, **values: Any) -> None:
        """Send a JSON message."""
        payload = encoded({"what": what, **values})
        if self.muted:
            self._hand_over(frame(NOTE, payload))
        else:
            self.send(NOTE, payload)

    def mute(self) -> None:
        """Send only JSON messages from now on."""
        self.flush()
        self.muted, self.counts = True, [0, 0]

    def send(self, kind: bytes, payload: bytes) -> None:
        """Send a frame."""
        self.write(frame(kind, payload))
        self.tick()

    def write(self, data: bytes) -> None:
        """Append bytes to the shared block, which is sent when it is full enough."""
        at, size = self.end, len(data)
        if at > self.limit or at + size > BLOCK_BYTES:
            at = self.make_room(size)
        if at + size <= BLOCK_BYTES:
            self.memory[at : at + size] = data
            self.sent(at + size)
        elif self.open and not self.muted:
            self._hand_over(data)
            if self._closed:
                self.make_room(size)

    def sent(self, end: int) -> None:
        """Set the end of the block's contents, after code has written to the block directly."""
        self.end = end
        self.counts[1] = end - BLOCK.size

    def make_room(self, size: int = SHORT_BYTES) -> int:
        """Send the shared block's contents; return the offset for the next bytes."""
        self.flush()
        if self._closed and self.open and self.end + size > BLOCK_BYTES - CUT_BYTES:
            end = self.end + len(_CUT)
            self.memory[self.end : end] = _CUT
            self.sent(end)
            self._forget()
        return self.end

    def tick(self) -> None:
        """Send bytes that have waited too long."""
        if _now() - self._flushed_at > FLUSH_S:
            self.flush()

    def flush(self) -> None:
        """Send the contents of the shared block."""
        if not self.open or self.muted:
            self.end = BLOCK.size
        elif self.end > BLOCK.size and not self._closed:
            self._hand_over(self.memory[BLOCK.size : self.end])

    @property
    def descriptor(self) -> int:
        """The descriptor of the pipe."""
        return self._pipe

    @property
    def sent_bytes(self) -> int:
        """Number of bytes sent through the pipe."""
        return self._before

    def become(self, pipe: int, block: int) -> None:
        """Switch to another pipe and shared block, in a new fork with nothing unsent."""
        os.pwrite(block, bytes(self.memory), 0)
        # In place: what is sent at every call keeps the memory's address.
        address = ctypes.addressof(ctypes.c_char.from_buffer(self.memory))
        mapped = ctypes.CDLL(None, use_errno=True).mmap
        mapped.restype, mapped.argtypes = ctypes.c_void_p, MMAP
        if mapped(address, SHARED_BYTES, READ_WRITE, SHARED_FIXED, block, 0) != address:
            raise OSError(ctypes.get_errno(), "the block cannot be mapped")
        os.dup2(pipe, self._pipe, inheritable=False)
        self._inode = os.fstat(self._pipe).st_ino
        self.inode_of_block = os.fstat(block).st_ino
        os.close(pipe)
        os.close(block)
        self._before = self.counts[0] = self.counts[1] = 0

    def close(self) -> None:
        """Send all remaining bytes, and close the pipe."""
        self.flush()
        self.leave()

    def leave(self) -> None:
        """Close the pipe without sending, in a process that the script forked."""
        if self.open:
            self._forget()
            if self._is_ours():
                close(self._pipe)

    def _forget(self) -> None:
        """Stop sending: drop everything from now on."""
        self.open = False
        self.memory, self.counts = bytearray(BLOCK_BYTES), [0, 0]
        self.counters = [0] * (APART + 1)
        self.answers = [0.0] * (PLACES * ANSWERS * EXTREMES)
        self.end, self.limit = BLOCK.size, BLOCK.size + FLUSH_BYTES

    def _hand_over(self, data: bytes | memoryview) -> None:
        # A script may close all files and open its own: never write into one of those.
        if not self._closed and not self._is_ours():
            self._closed, self.limit = True, 0
        if self._closed:
            return
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[write(self._pipe, rest) :]
        except BrokenPipeError:
            self.leave()
            self.gone = True
            return
        self._before += len(data)
        self.counts[1] = 0  # first: else, if this ends here, it would be read twice
        self.counts[0] = self._before
        self.end = BLOCK.size
        self._flushed_at = _now()

    def _is_ours(self) -> bool:
        try:
            return fstat(self._pipe).st_ino == self._inode
        except OSError:
            return False


def encoded(note: dict[str, Any]) -> bytes:
    """Return a JSON object as UTF-8; bytes of a file name that are not UTF-8 become `?`."""
    return _encode(note).encode("utf-8", "replace")


def frame(kind: bytes, payload: bytes) -> bytes:
    """Return a frame as bytes."""
    return HEADER.pack(kind, len(payload)) + payload


_encode = json.JSONEncoder(ensure_ascii=False).encode
_CUT = frame(NOTE, encoded({"what": "cut"}))
_now = time.perf_counter  # the real one: it is read before the clock is replaced

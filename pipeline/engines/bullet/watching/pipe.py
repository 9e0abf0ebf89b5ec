"""What the script's process sends to the recorder: frames, through a pipe.

A stream begins with `MAGIC`. Each frame is a kind (one letter), the length of its payload (uint32,
little-endian), and the payload. A stream may end at any byte: an incomplete frame is dropped.

Frames collect in a block of shared memory, and leave it in large writes. So nothing is lost when a
process crashes or is killed: the recorder reads the rest of the block.
"""

from __future__ import annotations

import json
import mmap
import os
import struct
import time
from typing import Any

MAGIC = b"DROPREC\x01"
"""The last byte is the version: both halves belong to the same drop, unless somebody mixes them."""
HEADER = struct.Struct("<cI")
"""Header of a frame: kind and length."""

NOTE, SAMPLE, CONTACTS, SET, IMAGE = b"J", b"S", b"C", b"P", b"I"
"""Kinds: a note is JSON, the others are numbers after a small head."""
HEAD = struct.Struct("<iq")
"""Head of samples, contacts and states set by calls: number of the world or body, and step."""
IMAGE_HEAD = struct.Struct("<I")
"""Head of an image: length of the JSON before its pixels."""

BLOCK = struct.Struct("<QQ")
"""At the block's start: bytes sent so far, and bytes in it now."""
BLOCK_BYTES = 1 << 20
CUT_BYTES = 64
"""Of the block, for the note that it is full and the pipe closed."""
LONGEST = 1 << 29
"""No payload is as long; four letters read as a length are longer."""
FLUSH_BYTES = 1 << 16
FLUSH_S = 0.25


class Pipe:
    """The sending end. Not for two threads at once: the sender holds `Watch.lock`."""

    def __init__(self, pipe: int, block: int) -> None:
        self._pipe = pipe
        self._inode = os.fstat(pipe).st_ino
        self._memory = mmap.mmap(block, BLOCK_BYTES)
        os.set_inheritable(pipe, False)
        os.close(block)
        self._before = self._used = 0
        self._flushed_at = _now()
        self.open = True
        self.gone = False
        """Whether the recorder is."""
        self._closed = False
        """Whether the script has closed it: then the block takes what still fits."""
        self.write(MAGIC)
        self.flush()

    def note(self, what: str, **values: Any) -> None:
        """Send a JSON object."""
        self.send(NOTE, encoded({"what": what, **values}))

    def send(self, kind: bytes, payload: bytes) -> None:
        """Send a frame."""
        self.write(frame(kind, payload))

    def write(self, data: bytes | memoryview) -> None:
        """Put bytes into the block, and send it when there is enough in it."""
        if not self.open:
            return
        if not self._fits(data):
            self.flush()
            if not self._fits(data):
                self._hand_over(data)
                if self._closed:
                    self.open = False
                    self._put(frame(NOTE, encoded({"what": "cut"})))
                return
        self._put(data)
        if self._used > FLUSH_BYTES or _now() - self._flushed_at > FLUSH_S:
            self.flush()

    def _fits(self, data: bytes | memoryview) -> bool:
        return BLOCK.size + self._used + len(data) <= BLOCK_BYTES - CUT_BYTES

    def _put(self, data: bytes | memoryview) -> None:
        start = BLOCK.size + self._used
        self._memory[start : start + len(data)] = data
        self._used += len(data)
        BLOCK.pack_into(self._memory, 0, self._before, self._used)

    def flush(self) -> None:
        """Send what is in the block."""
        if self.open and self._used and not self._closed:
            self._hand_over(self._memory[BLOCK.size : BLOCK.size + self._used])

    def close(self) -> None:
        """Send what is left, and close the pipe: nothing is sent after that."""
        self.flush()
        self.leave()

    def leave(self) -> None:
        """Close the pipe and send nothing, for a forked child, which shares the block."""
        if self.open:
            self.open = False
            if self._is_ours():
                os.close(self._pipe)

    def _hand_over(self, data: bytes | memoryview) -> None:
        # A script may close all files and open its own: never write into one of those.
        self._closed = self._closed or not self._is_ours()
        if self._closed:
            return
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(self._pipe, rest) :]
        except BrokenPipeError:
            self.leave()
            self.gone = True
            return
        self._before += len(data)
        self._used = 0
        BLOCK.pack_into(self._memory, 0, self._before, 0)
        self._flushed_at = _now()

    def _is_ours(self) -> bool:
        try:
            return os.fstat(self._pipe).st_ino == self._inode
        except OSError:
            return False


def encoded(note: dict[str, Any]) -> bytes:
    """Return a JSON object as UTF-8; bytes of a file name that are not UTF-8 become `?`."""
    return json.dumps(note, ensure_ascii=False).encode("utf-8", "replace")


def frame(kind: bytes, payload: bytes) -> bytes:
    """Return a frame as it goes through the pipe."""
    return HEADER.pack(kind, len(payload)) + payload


_now = time.perf_counter  # the real one: it is read before the clock is replaced

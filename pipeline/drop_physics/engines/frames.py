"""Splits a stream of bytes into the frames defined in `watching.pipe`."""

from __future__ import annotations

from collections.abc import Iterator

from drop_physics.engines.watching import pipe
from drop_physics.errors import DropError

FRAMES = {pipe.NOTE, pipe.SAMPLE, pipe.SET, pipe.CALL, pipe.RESULT, pipe.IMAGE, pipe.MUJOCO}


class StreamError(DropError):
    """A stream that does not come from drop's watching code."""


class FrameStream:
    """The frames of a stream that may arrive in pieces of any size, and end at any byte."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        """The parts of an incomplete frame that have arrived."""
        self._held, self._wanted = 0, len(pipe.MAGIC)
        self._begun = False
        self.broken = False
        """Whether something else was written into the stream, so that the rest cannot be read."""

    @property
    def is_cut(self) -> bool:
        """True if the last frame is incomplete."""
        return self._held > 0

    def feed(self, data: bytes) -> Iterator[tuple[bytes, bytes]]:
        """Yield kind and payload of each frame that is now complete.

        Raises
        ------
        StreamError
            If the stream does not begin as drop's streams do.
        """
        if self.broken or not data:
            return
        self._pieces.append(data)
        self._held += len(data)
        if self._held < self._wanted:
            return
        data = b"".join(self._pieces)
        offset = 0
        try:
            if not self._begun:
                if not data.startswith(pipe.MAGIC):
                    raise StreamError(
                        "the script's process runs another version of drop; run it again"
                    )
                self._begun, offset = True, len(pipe.MAGIC)
            size, head, unpack = len(data), pipe.HEADER.size, pipe.HEADER.unpack_from
            self._wanted = head
            while size - offset >= head:
                kind, length = unpack(data, offset)
                if kind not in FRAMES or length >= pipe.LONGEST:
                    self.broken = True
                    return
                end = offset + head + length
                if size < end:
                    self._wanted = end - offset
                    return
                payload = data[offset + head : end]
                offset = end
                yield kind, payload
                if self.broken:
                    return
        finally:
            rest = b"" if self.broken else data[offset:]
            self._pieces, self._held = [rest], len(rest)

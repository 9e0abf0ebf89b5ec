"""Captures what C libraries print, so that it does not reach the user's terminal."""

from __future__ import annotations

import ctypes
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def c_output_moved_aside() -> Iterator[list[str]]:
    """Capture text printed by C libraries, such as Bullet's warnings, in a `with` block.

    C libraries write to file descriptors 1 and 2, whatever `sys.stdout` is, and buffer their text;
    both streams are flushed before and after the block. The yielded list contains the text when the
    block has ended.
    """
    libc = ctypes.CDLL(None) if os.name == "posix" else ctypes.cdll.msvcrt
    printed: list[str] = []
    with tempfile.TemporaryFile() as aside:
        libc.fflush(None)
        kept = {fd: os.dup(fd) for fd in (1, 2) if _is_open(fd)}
        for fd in kept:
            os.dup2(aside.fileno(), fd)
        try:
            yield printed
        finally:
            libc.fflush(None)
            for fd, copy in kept.items():
                os.dup2(copy, fd)
                os.close(copy)
            aside.seek(0)
            printed.append(aside.read().decode(errors="replace"))


def _is_open(fd: int) -> bool:
    try:
        os.fstat(fd)
    except OSError:
        return False
    return True

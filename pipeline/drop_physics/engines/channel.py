"""The channel from a watched process to its listener: a pipe, and shared memory for unsent bytes.

This module imports little, since a user's process with a watched block loads it, too.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from pathlib import Path
from typing import IO

from rich.filesize import decimal

from drop_physics.engines.watching import pipe
from drop_physics.errors import OutputError
from drop_physics.messages import Message

WATCHING = Path(__file__).with_name("watching")
"""The folder of drop's code that runs in a script's interpreter."""


def shared_block() -> IO[bytes]:
    """Return an unnamed file that a watched process and its listener both map into memory.

    Raises
    ------
    OutputError
        If there is too little disk space or memory for the file.
    """
    try:
        block = tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
        try:
            block.truncate(pipe.SHARED_BYTES)
            # Else, on a full disk, the process that maps it would die when it first writes to it.
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(block.fileno(), 0, pipe.SHARED_BYTES)
        except BaseException:
            block.close()
            raise
    except OSError as error:
        raise OutputError(
            "a temporary file of {size}, which the script's process writes to, cannot be created "
            "in {folder}: {reason}; make room there, set TMPDIR to another folder, or see: "
            "ulimit -f",
            size=decimal(pipe.SHARED_BYTES),
            folder=tempfile.tempdir or Message("any folder"),
            reason=error.strerror,
        ) from error
    return block


def wide_pipe() -> tuple[int, int]:
    """Return the ends of a pipe with a large buffer, so that large writes rarely block."""
    ends = os.pipe()
    with contextlib.suppress(AttributeError, OSError):  # only Linux has it, within limits
        fcntl.fcntl(ends[1], fcntl.F_SETPIPE_SZ, pipe.BLOCK_BYTES)
    return ends

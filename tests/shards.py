"""Work for workers in tests of workers alone; it imports next to nothing."""

from __future__ import annotations

import os
import signal
import time

from drop_physics.errors import OutputError


def double(shard: int) -> int:
    """Return twice the number; the third one fails."""
    if shard == 3:
        raise OutputError("three")
    return 2 * shard


def nap(shard: int) -> int:
    """Take some time."""
    time.sleep(0.02)
    return shard


def first_is_quick(shard: int) -> int:
    """Take very long, but not for the first."""
    time.sleep(600 if shard else 0)
    return shard


def always_dies(_: int) -> None:
    """End the worker."""
    os.kill(os.getpid(), signal.SIGKILL)

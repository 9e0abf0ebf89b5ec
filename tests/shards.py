"""Functions for the tests of worker processes."""

from __future__ import annotations

import os
import signal
import time

from drop_physics.errors import OutputError


def double(shard: int) -> int:
    """Return twice a number; fail for the third."""
    if shard == 3:
        raise OutputError("three")
    return 2 * shard


def nap(shard: int) -> int:
    """Sleep for a moment."""
    time.sleep(0.02)
    return shard


def first_is_quick(shard: int) -> int:
    """Take very long, except for the first task."""
    time.sleep(600 if shard else 0)
    return shard


def always_dies(_: int) -> None:
    """Kill the worker process that runs this."""
    os.kill(os.getpid(), signal.SIGKILL)

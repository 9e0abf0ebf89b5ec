"""Limits a run's processor time and memory, and ends the run with its parent process."""

from __future__ import annotations

import ctypes
import math
import os
import signal
import sys
from typing import Any

PR_SET_PDEATHSIG, SIGKILL = 1, 9
"""Numbers from Linux's `sys/prctl.h` and `signal.h`."""
MOST_WANTED = "1000"
"""The OOM score with which Linux kills a process first when memory runs out."""


def end_with_parent() -> None:
    """Make the system end this process when its parent is killed."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, SIGKILL)


def keep(limits: dict[str, Any]) -> None:
    """Limit processor time and memory of this process and its forks.

    Parameters
    ----------
    limits
        `processor_s`, the processor time of each process [s], and `bytes`, the private memory of
        each; None for no limit.
    """
    import resource

    for which, most in (
        (resource.RLIMIT_CPU, limits["processor_s"]),
        (resource.RLIMIT_DATA, limits["bytes"]),
    ):
        _, hard = resource.getrlimit(which)
        if most is not None and (hard == resource.RLIM_INFINITY or most < hard):
            resource.setrlimit(which, (math.ceil(most), hard))
    if sys.platform == "linux":
        with open("/proc/self/oom_score_adj", "w") as file:
            file.write(MOST_WANTED)


def lead_a_group() -> None:
    """Make this new process lead a process group, which can be ended as a whole."""
    os.setpgid(0, 0)
    end_with_parent()
    signal.signal(signal.SIGXCPU, signal.SIG_DFL)

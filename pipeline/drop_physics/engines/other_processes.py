"""Finds engines loaded by processes that a script started, whose steps are not recorded."""

from __future__ import annotations

import re
import time
from contextlib import suppress
from pathlib import Path

ENGINE = re.compile(rb"^(\S+) .*/(?:pybullet|libmujoco)[^/]*\.so[^/]*$", re.MULTILINE)
"""Pattern of a process's memory mapping that is an engine's library, with its address."""
LOOKS_S = 0.1, 1.0
"""Time [s] after which a new process is first examined; the interval then doubles, up to the second
number."""


class OtherProcesses:
    """Checks periodically whether a child process of the script has loaded an engine itself.

    One that was forked has the script's, at the same addresses, and tells itself that it steps.

    Parameters
    ----------
    script
        The number of the script's own process.
    """

    def __init__(self, script: int) -> None:
        self._script = script
        self.found = False
        self._due = 0.0
        self._next: dict[int, tuple[float, float]] = {}
        """Next time to examine each process, and the interval before [s]."""

    def look(self) -> None:
        """Check the processes whose turn it is: new ones often, old ones rarely."""
        now, (first, last) = time.monotonic(), LOOKS_S
        if self.found or now < self._due:
            return
        self._due = now + first
        for process in _started_by(self._script):
            due, since = self._next.get(process, (now, first))
            if due <= now:
                self._next[process] = now + since, min(2 * since, last)
                its = _engines_in(process)
                self.found |= bool(its and its - _engines_in(self._script))


def _started_by(process: int) -> list[int]:
    """Return the descendants of a process, as Linux lists them."""
    found: list[int] = []
    with suppress(OSError):  # one has ended: it is looked at again
        for tasks in Path("/proc").glob(f"{process}/task/*/children"):
            for child in map(int, tasks.read_text().split()):
                found += [child, *_started_by(child)]
    return found


def _engines_in(process: int) -> set[bytes]:
    try:
        return {*ENGINE.findall(Path(f"/proc/{process}/maps").read_bytes())}
    except OSError:
        return set()

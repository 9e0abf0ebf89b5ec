"""Finds engines loaded by a script's child processes, whose steps are not recorded."""

from __future__ import annotations

import re
import time
from contextlib import suppress
from pathlib import Path

ENGINE = re.compile(rb"^(\S+) .*/(?:pybullet|libmujoco)[^/]*\.so[^/]*$", re.MULTILINE)
"""Pattern of an engine's library in the list of a process's memory mappings, with its address."""
LOOKS_S = 0.1, 1.0
"""Time [s] after which a new process is first examined, and the longest interval between
examinations, up to which the interval doubles."""


class OtherProcesses:
    """Checks periodically whether a child process of the script has loaded an engine itself.

    A forked child has the script's engine at the same addresses; it is ignored here, since it
    reports its steps itself.

    Parameters
    ----------
    script
        The id of the script's process.
    """

    def __init__(self, script: int) -> None:
        self._script = script
        self.found = False
        self._due = 0.0
        self._next: dict[int, tuple[float, float]] = {}
        """Next time to examine each process, and the interval before [s]."""

    def look(self) -> None:
        """Check the processes that are due: new ones often, old ones rarely."""
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

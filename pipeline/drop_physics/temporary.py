"""Temporary folders of `drop`; those left by killed processes are removed by the next process.

A folder's name contains the id and the start time of the process that created it. As long as that
process lives, it also holds a lock on the folder, which is visible to other machines and
containers. If a signal interrupts the creation of a folder, the folder is removed when the process
ends.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import re
import secrets
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

NAME = re.compile(r"drop-(\d+)-(\d+)-\w+")
"""Pattern of a folder's name: process id and start time in clock ticks."""
STARTED = 19
"""Index of the start time in `/proc/PID/stat`, after the program's name."""
WAITS_S = 0.0, 0.01, 0.1, 0.5
"""Delays before each attempt to delete a folder [s], since an ending process may still write."""


class TemporaryFolder:
    """A temporary folder that exists until it is closed.

    Raises
    ------
    OSError
        If the folder cannot be created.
    """

    def __init__(self) -> None:
        self._owner, self._lock = os.getpid(), None
        name = f"drop-{self._owner}-{_started(self._owner) or 0}-{secrets.token_hex(4)}"
        self.path = Path(tempfile.gettempdir(), name)
        atexit.register(self._close_at_end)
        self.path.mkdir(mode=0o700)
        self._lock = _locked(self.path)

    def close(self) -> None:
        """Delete the folder with its contents."""
        _remove(self.path)
        atexit.unregister(self._close_at_end)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _close_at_end(self) -> None:
        if os.getpid() == self._owner:  # not what was forked
            self.close()


@contextlib.contextmanager
def temporary_folder() -> Iterator[Path]:
    """Yield a new temporary folder, which is deleted at the end of the block."""
    folder = TemporaryFolder()
    try:
        yield folder.path
    finally:
        folder.close()


def is_temporary(path: Path) -> bool:
    """Return whether a file is inside a temporary folder of drop, and will be deleted."""
    return any(NAME.fullmatch(parent.name) for parent in path.parents)


def remove_leftovers() -> None:
    """Delete the temporary folders of killed processes of drop, on Linux, where `/proc` exists."""
    if _started(os.getpid()) is None:
        return
    with contextlib.suppress(OSError), os.scandir(tempfile.gettempdir()) as entries:
        for entry in entries:
            found = NAME.fullmatch(entry.name)
            if found is None or not entry.is_dir(follow_symlinks=False):
                continue
            if entry.stat(follow_symlinks=False).st_uid != os.getuid():
                continue
            if _started(int(found[1])) != int(found[2]):
                lock = _locked(Path(entry.path))
                if lock is not None:
                    _remove(Path(entry.path))
                    os.close(lock)


def _started(number: int) -> int | None:
    """Return a process's start time in clock ticks since boot; None if the process has ended."""
    try:
        stat = Path(f"/proc/{number}/stat").read_text(errors="replace")
        return int(stat.rpartition(")")[2].split()[STARTED])
    except (OSError, IndexError, ValueError):
        return None


def _locked(folder: Path) -> int | None:
    """Lock a folder and return the descriptor; None if it is locked already or does not exist."""
    if fcntl is None:
        return None
    descriptor = -1
    try:
        descriptor = os.open(folder, os.O_RDONLY)
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        if descriptor >= 0:
            os.close(descriptor)
        return None
    return descriptor


def _remove(folder: Path) -> None:
    for wait_s in WAITS_S:
        time.sleep(wait_s)
        for at, folders, _ in os.walk(folder):
            for each in folders:  # overlayfs lets nobody look into its own
                if not Path(at, each).is_symlink():
                    with contextlib.suppress(OSError):
                        Path(at, each).chmod(0o700)
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return

"""What a script reaches beside its simulation, so that it is not run again unasked.

Sockets, other programs, devices, and files that it writes elsewhere than in its working directory
or in the system's folder for temporary ones; of the files there, those that another run of it would
write, too. What a library starts while it is imported is its own. Python tells an audit hook, which
cannot be taken off again: it is for an interpreter that is the script's own.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any

from .draws import is_imported

CONNECTS = ("socket.connect", "socket.bind", "socket.sendto")
STARTS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.spawn")
TEMPORARY = ("/tmp", "/var/tmp", "/usr/tmp", os.curdir)
"""Where Python makes temporary files, unless the environment names a folder."""
MAKES = ("tempfile.mkstemp", "tempfile.mkdtemp")
REMOVES = ("os.remove", "os.rename", "os.rmdir", "os.truncate")
WRITES = os.O_WRONLY | os.O_RDWR | os.O_APPEND
QUIET = ("/dev/null", "/dev/tty", "/dev/shm/", "/dev/urandom", "/proc/")
"""Devices that nothing comes of."""
CACHES = (f"{os.sep}__pycache__{os.sep}", f"{os.sep}.cache{os.sep}", f"matplotlib{os.sep}")
"""Parts of paths that libraries write for themselves."""
MOST = 8
"""Things that are told."""


class Outside:
    """Tells what a script reaches outside, each thing once.

    Parameters
    ----------
    tell
        Called with what it is, `connects`, `starts`, `removes`, `writes` or, in those folders,
        `keeps` where a copy of the working directory would take it, else `keeps there`, and its
        name.
    """

    def __init__(self, tell: Callable[[str, str], None]) -> None:
        self._tell = tell
        self._told: set[tuple[str, str]] = set()
        self._own: set[str] = set()
        """Temporary files and folders, whose names no other run has."""
        self.on = True
        self._began = os.path.realpath(os.getcwd())
        # `tempfile` itself would draw a name, and with it what the script draws next.
        told = [os.environ.get(name) for name in ("TMPDIR", "TEMP", "TMP")]
        folder = next(each for each in (*told, *TEMPORARY) if each and os.path.isdir(each))
        temporary = {folder, os.path.realpath(folder)}
        self._allowed = tuple(os.path.join(each, "") for each in temporary)

    def listen(self) -> None:
        """Begin."""
        sys.addaudithook(self._hear)

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            if self.on and flags & WRITES and (type(path) is str or type(path) is bytes):
                self._file("writes", os.fsdecode(path))
        elif not self.on:
            return
        elif event in MAKES:
            self._own.add(os.path.realpath(os.fsdecode(arguments[0])))
        elif event in CONNECTS:
            self._note("connects", str(arguments[1])[:80])
        elif event in STARTS and not is_imported(sys._getframe(1)):
            self._note("starts", str(arguments[0])[:80])
        elif event in REMOVES and type(arguments[0]) is str:
            self._file("removes", arguments[0])

    def _file(self, what: str, path: str) -> None:
        try:
            whole = os.path.realpath(path)
            here = os.path.join(os.path.realpath(os.getcwd()), "")
        except OSError:
            return
        if whole.startswith(QUIET) or any(part in whole for part in CACHES):
            return
        # A file without a name is opened by its folder's.
        inside = os.path.join(whole, "").startswith((here, *self._allowed))
        if not inside:
            self._note(what, whole)
        elif os.path.isdir(whole):
            return
        elif what == "writes" and not whole.startswith(tuple(self._own)):
            copied = not os.path.isabs(path) and os.path.realpath(os.getcwd()) == self._began
            self._note("keeps" if copied else "keeps there", whole)

    def _note(self, what: str, name: str) -> None:
        key = what, name
        if key not in self._told and len(self._told) < MOST:
            self._told.add(key)
            self.on = False  # what telling opens is ours
            try:
                self._tell(what, name)
            finally:
                self.on = True

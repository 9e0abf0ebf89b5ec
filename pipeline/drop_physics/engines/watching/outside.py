"""Notes which files, programs and networks a script uses, to decide whether it may run again.

It reports sockets, other programs, devices, and written files: all files outside the working
directory and the system's temporary folder, and those inside that a further run would write, too.
Calls are reported by Python's audit hook; files opened by C code are looked up in `/proc`, at the
first step and at the end. Actions of a library during its import are ignored. An audit hook cannot
be removed, so this is only for an interpreter that runs a single script.
"""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable
from typing import Any

from . import descriptors
from .draws import is_imported

CONNECTS = ("socket.connect", "socket.bind", "socket.sendto")
STARTS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.spawn")
TEMPORARY = ("/tmp", "/var/tmp", "/usr/tmp", os.curdir)
"""Candidates for the folder of Python's temporary files, unless an environment variable names it.
"""
OWN = ("tempfile.mkstemp", "tempfile.mkdtemp")
REMOVES = ("os.remove", "os.rename", "os.rmdir", "os.truncate")
CHANGES = ("os.chmod", "os.chown", "os.utime", "os.setxattr", "os.removexattr")
MAKES = ("os.mkdir", "sqlite3.connect")
LINKS = ("os.symlink", "os.link", "os.rename")
"""Functions whose second argument is the path that they create."""
QUIET = ("/dev/shm/", "/dev/dri/", "/dev/nvidia", "/dev/kfd", "/proc/")
"""Devices without side effects, as renderers use them."""
CACHES = (f"{os.sep}__pycache__{os.sep}", f"{os.sep}.cache{os.sep}", f"matplotlib{os.sep}")
"""Parts of paths to which libraries write caches."""
MOST = 8
"""Largest number of resources that are reported."""
MOST_MADE = 1000
"""Largest number of created files and folders that are reported."""


class Outside:
    """Reports each file, device, program or network that a script uses, once.

    Parameters
    ----------
    tell
        A function that is called with an action and a name. The actions are `connects`, `starts`,
        `opens` (a device), `removes` and `writes`; in the working directory and the temporary
        folder `keeps` (a copy of the working directory would include the file), `keeps there` (it
        would not) or `makes` (the file is new).
    ours
        A function that returns the descriptors that belong to drop.
    """

    def __init__(self, tell: Callable[[str, str], None], ours: Callable[[], set[int]]) -> None:
        self._tell, self._ours = tell, ours
        self._told: set[tuple[str, str]] = set()
        self._own: set[str] = set()
        """Temporary files and folders, whose names differ in each run."""
        self._made = 0
        self.on = True
        self._began = os.path.realpath(os.getcwd())
        # `tempfile` itself would draw a name, and with it what the script draws next.
        told = [os.environ.get(name) for name in ("TMPDIR", "TEMP", "TMP")]
        folder = next(each for each in (*told, *TEMPORARY) if each and os.path.isdir(each))
        temporary = {folder, os.path.realpath(folder)}
        self._allowed = tuple(os.path.join(each, "") for each in temporary)

    def listen(self) -> None:
        """Start listening to audit events."""
        sys.addaudithook(self._hear)

    def look(self) -> None:
        """Report the resources that are open now, whichever code opened them."""
        if not sys.platform.startswith("linux"):
            return
        networks = _network_sockets()
        for number in descriptors.numbers(self._ours()):
            try:
                status, path = os.fstat(number), os.readlink(descriptors.link(number))
            except OSError:  # another thread has closed it
                continue
            mode = status.st_mode
            if stat.S_ISSOCK(mode) and path[len("socket:[") : -1] in networks:
                self._note("connects", "a socket")
            elif stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
                self._device(path)
            elif stat.S_ISREG(mode) and status.st_nlink and descriptors.is_written(number):
                self._file("writes", path)

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            if self.on and flags & (descriptors.WRITES | os.O_APPEND) and _is_path(path):
                self._file("writes", os.fsdecode(path))
        elif not self.on:
            return
        elif event in OWN:
            self._own.add(os.path.realpath(os.fsdecode(arguments[0])))
        elif event in CONNECTS:
            self._note("connects", str(arguments[1])[:80])
        elif event in STARTS and not is_imported(sys._getframe(1)):
            self._note("starts", str(arguments[0])[:80])
        else:
            self._hear_of_file(event, arguments)

    def _hear_of_file(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event in REMOVES and _is_path(arguments[0]):
            self._file("removes", os.fsdecode(arguments[0]))
        elif event in (*CHANGES, *MAKES) and _is_path(arguments[0]):
            self._file("writes", os.fsdecode(arguments[0]))
        if event in LINKS and _is_path(arguments[1]):
            self._file("writes", os.fsdecode(arguments[1]))

    def _file(self, what: str, path: str) -> None:
        try:
            # A link itself is made or removed, and what it leads to is written.
            folder, name = os.path.split(os.path.abspath(path))
            whole = os.path.join(os.path.realpath(folder), name)
            if what == "writes":
                whole = os.path.realpath(whole)
            here = os.path.join(os.path.realpath(os.getcwd()), "")
            mode = os.stat(whole).st_mode if os.path.exists(whole) else 0
        except (OSError, ValueError):
            return
        if stat.S_ISCHR(mode) or stat.S_ISBLK(mode) or stat.S_ISFIFO(mode):
            self._device(whole)
            return
        if whole.startswith(QUIET) or any(part in whole for part in CACHES):
            return
        if what == "writes" and not os.path.lexists(whole) and self._made < MOST_MADE:
            self._made += not whole.startswith(tuple(self._own))
            self._send("makes", whole)
        # A file without a name is opened by its folder's.
        inside = os.path.join(whole, "").startswith((here, *self._allowed))
        if not inside:
            self._note(what, whole)
        elif stat.S_ISDIR(mode):
            return
        elif what == "writes" and not whole.startswith(tuple(self._own)):
            copied = not os.path.isabs(path) and os.path.realpath(os.getcwd()) == self._began
            self._note("keeps" if copied else "keeps there", whole)

    def _device(self, path: str) -> None:
        if not path.startswith((*descriptors.HARMLESS, *QUIET)):
            self._note("opens", path)

    def _note(self, what: str, name: str) -> None:
        if len(self._told) < MOST and (what, name) not in self._told:
            self._told.add((what, name))
            self._send(what, name)

    def _send(self, what: str, name: str) -> None:
        self.on = False  # what telling opens is ours
        try:
            self._tell(what, name)
        finally:
            self.on = True


def _is_path(argument: object) -> bool:
    return type(argument) is str or type(argument) is bytes


def _network_sockets() -> set[str]:
    """Return the inodes of sockets with a network connection; local sockets are left out."""
    found = set()
    for name in ("tcp", "tcp6", "udp", "udp6", "raw", "raw6"):
        try:
            with open(f"/proc/self/net/{name}") as file:
                found |= {line.split()[9] for line in [*file][1:]}
        except OSError:
            continue
    return found

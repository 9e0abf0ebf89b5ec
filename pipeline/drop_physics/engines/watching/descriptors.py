"""Finds the resources that a forked process would share with its parent: files, mappings, threads.

A child inherits open files: it shares the parent's offset, and writes to the same file. Therefore,
the child opens each regular file again, and writes to a copy. Resources that cannot be copied, such
as sockets, devices, databases and threads, forbid a fork. Only Linux lists all of them, in `/proc`.
"""

from __future__ import annotations

import ctypes
import gc
import io
import os
import re
import stat
import sys
import threading
from collections.abc import Collection
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .private import Private

STANDARD = (0, 1, 2)
HARMLESS = (
    *("/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom", "/dev/tty"),
    "/dev/pts/",
)
"""Devices that a parent and its child may share."""
DATABASE = b"SQLite format 3\0"
"""The first bytes of an SQLite database."""
POOL = re.compile(r"\S*openblas\S*\.so\S*")
"""A library whose thread pool restarts in a forked child."""
POOL_SIZES = (
    *("openblas_get_num_threads", "openblas_get_num_threads64_"),
    *("scipy_openblas_get_num_threads", "scipy_openblas_get_num_threads64_"),
)
"""Functions that return the number of threads in OpenBLAS's pool, including the caller."""
WRITES = os.O_WRONLY | os.O_RDWR
KEPT_FLAGS = WRITES | os.O_APPEND
"""Flags that are kept when a file is reopened."""


def shared(ours: Collection[int], block: int) -> str:
    """Return the resource that forbids forking this process; empty if there is none.

    Parameters
    ----------
    ours
        Descriptors that belong to drop.
    block
        The inode of the memory shared with the recorder.
    """
    if not sys.platform.startswith("linux"):
        return "no /proc"
    return _thread() or _mapping(block) or next(filter(None, map(_kind, numbers(ours))), "")


def flush() -> None:
    """Flush the output buffers of this process, Python's and C's."""
    for each in gc.get_objects():
        if isinstance(each, (io.BufferedWriter, io.BufferedRandom, io.TextIOWrapper)):
            try:
                each.flush()
            except (OSError, ValueError):  # closed, or detached, or its disk is full
                continue
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (AttributeError, OSError, ValueError):
            continue
    ctypes.CDLL(None).fflush(None)


def replace(ours: Collection[int], private: Private | None, printed: int) -> None:
    """Give a forked process its own copies of the files that are open for writing.

    Parameters
    ----------
    ours
        Descriptors that belong to drop.
    private
        The child's view of the file system, which has been entered; None for the machine's own.
    printed
        The descriptor to which standard output and standard error are redirected.
    """
    for number in numbers(ours):
        if not stat.S_ISREG(os.fstat(number).st_mode):
            continue
        own = _copied(number, private) if is_written(number) else _reopened(number)
        os.lseek(own, os.lseek(number, 0, os.SEEK_CUR), os.SEEK_SET)
        os.dup2(own, number, inheritable=os.get_inheritable(number))
        os.close(own)
    for number in STANDARD[1:]:
        os.dup2(printed, number)


def _reopened(number: int) -> int:
    return os.open(link(number), os.O_RDONLY)


def _copied(number: int, private: Private | None) -> int:
    """Copy an open file for a fork; return a descriptor of the copy.

    Within a private view of the file system, opening the path is enough: writes go to a copy. Any
    other file is copied as a whole.
    """
    path, flags = os.readlink(link(number)), _flags(number) & KEPT_FLAGS
    if private is not None and private.holds(path) and _is_at(path, os.fstat(number)):
        return os.open(path, flags)
    if private is None:
        name = f"/dev/shm/drop-{os.getpid()}-{number}"
    else:
        name = private.file(f"descriptor-{number}")
    with open(link(number), "rb") as source, open(name, "xb") as copy:
        while os.sendfile(copy.fileno(), source.fileno(), None, 1 << 30):
            pass
    own = os.open(name, flags)
    os.unlink(name)
    return own


def _is_at(path: str, status: os.stat_result) -> bool:
    """Return whether a path leads to an open file, judging by size and modification time.

    Other attributes may differ in an overlay.
    """
    try:
        there = os.stat(path)
    except OSError:
        return False
    return (there.st_size, there.st_mtime_ns) == (status.st_size, status.st_mtime_ns)


def link(number: int) -> str:
    """Return the path through which a descriptor's file can be reopened."""
    return f"/proc/self/fd/{number}"


def numbers(ours: Collection[int]) -> list[int]:
    """Return the open file descriptors, except drop's and the standard streams."""
    with os.scandir("/proc/self/fd") as listed:
        found = sorted(int(each.name) for each in listed)
    return [each for each in found if each not in (*ours, *STANDARD) and _is_open(each)]


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:  # it was that of the listing
        return False
    return True


def is_written(number: int) -> bool:
    """Return whether a descriptor is open for writing."""
    return bool(_flags(number) & WRITES)


def _flags(number: int) -> int:
    with open(f"/proc/self/fdinfo/{number}") as file:
        return next(int(line.split()[1], 8) for line in file if line.startswith("flags:"))


def _kind(number: int) -> str:
    """Return the kind of a descriptor that a fork must not share; empty for others."""
    mode, path = os.fstat(number).st_mode, os.readlink(link(number))
    if stat.S_ISREG(mode):
        return "a database" if _is_database(number) else ""
    if stat.S_ISDIR(mode):
        return ""
    if stat.S_ISSOCK(mode):
        return "a socket"
    if stat.S_ISFIFO(mode):
        return "a pipe"
    if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        return "" if path.startswith(HARMLESS) else f"the device {path}"
    return path


def _is_database(number: int) -> bool:
    if not is_written(number):
        return False
    try:
        with open(link(number), "rb") as file:
            begins = file.read(len(DATABASE))
    except OSError:
        return False
    return begins == DATABASE or (not begins and "sqlite3" in sys.modules)


def _mapping(block: int) -> str:
    """Return a memory mapping that other processes may write to, except drop's own."""
    with open("/proc/self/maps", encoding="utf-8", errors="surrogateescape") as file:
        for line in file:
            _, how, _, _, inode, *path = line.split(maxsplit=5)
            if how[1] == "w" and how[3] == "s" and int(inode) != block:
                return f"shared memory {''.join(path).strip()}"
    return ""


def _thread() -> str:
    """Describe the threads besides this one and harmless pools; empty if there are none."""
    if threading.active_count() > 1:
        return "a thread"
    here = _thread_name(str(os.getpid()))
    others = [_thread_name(each) for each in os.listdir("/proc/self/task")]
    others.remove(here)
    if any(each != here for each in others) or len(others) > _pools():
        return "a thread of a library"
    return ""


def _thread_name(number: str) -> str:
    try:
        with open(f"/proc/self/task/{number}/comm", errors="replace") as file:
            return file.read()
    except OSError:  # it has ended
        return ""


def _pools() -> int:
    """Return how many threads belong to pools that survive a fork, such as OpenBLAS's."""
    with open("/proc/self/maps", encoding="utf-8", errors="surrogateescape") as file:
        libraries = set(POOL.findall(file.read()))
    return sum(_pool(library) - 1 for library in libraries)


def _pool(library: str) -> int:
    loaded: Any = ctypes.CDLL(library)
    size = next((getattr(loaded, name) for name in POOL_SIZES if hasattr(loaded, name)), None)
    return 1 if size is None else int(size())

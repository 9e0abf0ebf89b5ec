"""A private view of the file system, in which a run cannot change the user's files.

The process gets a mount namespace of its own. Folders that a script writes to are overlaid
(overlayfs, Linux 5.13 or later): writes go to a scratch folder, from which they are read again. All
other folders are read-only, and the network can be disabled. A forked child gets separate layers on
top of its parent's writes so far.

If the kernel refuses, `enter` raises OSError, and the process has to end.
"""

from __future__ import annotations

import ctypes
import json
import os
import stat
import sys
from collections.abc import Iterator
from typing import Any

CLONE_NEWNS, CLONE_NEWUSER, CLONE_NEWNET = 0x20000, 0x10000000, 0x40000000
"""Flags of `unshare`, from Linux's `sched.h`."""
MS_BIND, MS_REC, MS_PRIVATE = 0x1000, 0x4000, 0x40000
"""Flags of `mount`, from Linux's `sys/mount.h`."""
MOUNT_SETATTR, AT_FDCWD, AT_RECURSIVE, MOUNT_ATTR_RDONLY = 442, -100, 0x8000, 1
"""The number of the system call `mount_setattr`, the same on all architectures, and its flags."""
DISPLAYS = "/tmp/.X11-unix"
"""Folder of the X server's sockets."""
CAPABILITIES_V3 = 0x20080522
"""Version of the structures that `capset` takes (`linux/capability.h`)."""
MOUNTED = 4
"""Index of the mount point in a line of `/proc/self/mountinfo`."""


class Private:
    """A private file-system view, whose writes go to a scratch folder.

    Parameters
    ----------
    scratch
        A folder of drop, to which all writes go.
    folders
        The folders that the script may write to; one of them contains the working directory.
    made
        Files and folders that are hidden, since the script's first run created them.
    network
        Whether the script can use the network.
    """

    def __init__(self, scratch: str, folders: list[str], made: list[str], *, network: bool) -> None:
        self._scratch, self._folders, self._network = os.path.realpath(scratch), folders, network
        self._made, self._name = made, "run"
        self._layers: list[str] = []
        """Folders that are overlaid."""
        self._options = ""
        """Further options of overlays."""

    def enter(self) -> None:
        """Enter the view, in a process with one thread.

        Raises
        ------
        OSError
            If the kernel does not support private views.
        """
        here = os.getcwd()
        self._unshare()
        os.chdir(self._scratch)
        for folder in _apart(self._folders):
            below = _below(len(self._layers))
            os.makedirs(below, exist_ok=True)
            try:
                _mount(folder, below, flags=MS_BIND)
                self._overlay(len(self._layers), folder)
            except OSError:  # another may hold the working directory
                continue
            self._layers.append(folder)
        if not any(_is_in(here, layer) for layer in self._layers):
            raise OSError("no layer can be put over the working directory")
        _set_attributes("/", _Attributes(set=MOUNT_ATTR_RDONLY), AT_RECURSIVE)
        _mount(".", self._scratch, flags=MS_BIND | MS_REC)
        for each in (*self._layers, self._scratch, "/proc"):
            _set_writable(each)
        self._keep_displays()
        os.chdir(here)
        for path in self._made:
            _remove(path)
        _keep_capabilities(on=False)

    def part(self, name: str) -> None:
        """Switch to separate writable layers, in a new fork."""
        here, before = os.getcwd(), self._name
        _keep_capabilities(on=True)
        _unshare(CLONE_NEWNS)
        _mount("none", "/", flags=MS_REC | MS_PRIVATE)
        os.chdir(self._scratch)
        self._name = name
        for number, folder in enumerate(self._layers):
            own = os.path.join(name, str(number), "upper")
            os.makedirs(os.path.dirname(own))
            _copy(os.path.join(before, str(number), "upper"), own)
            self._overlay(number, folder)
        _mount(".", self._scratch, flags=MS_BIND | MS_REC)
        self._keep_displays()
        os.chdir(here)
        _keep_capabilities(on=False)

    def holds(self, path: str) -> bool:
        """Return whether a path lies in one of the writable layers."""
        return any(_is_in(path, layer) for layer in self._layers)

    def file(self, name: str) -> str:
        """Return the path of a file of drop in the scratch folder."""
        folder = os.path.join(self._scratch, self._name)
        os.makedirs(folder, exist_ok=True)
        return os.path.join(folder, name)

    def _unshare(self) -> None:
        """Leave the shared mount namespace, by privilege or as a user in a new namespace."""
        network = 0 if self._network else CLONE_NEWNET
        user, group = os.geteuid(), os.getegid()
        try:
            _unshare(CLONE_NEWNS | network)
        except PermissionError:
            _unshare(CLONE_NEWUSER | CLONE_NEWNS | network)
            for name, text in (
                ("setgroups", "deny"),
                ("uid_map", f"{user} {user} 1"),
                ("gid_map", f"{group} {group} 1"),
            ):
                with open(f"/proc/self/{name}", "w") as file:
                    file.write(text)
            self._options = ",userxattr"
        _mount("none", "/", flags=MS_REC | MS_PRIVATE)

    def _keep_displays(self) -> None:
        """Keep the display sockets reachable, since a socket in a layer has no listener."""
        for number, folder in enumerate(self._layers):
            if _is_in(DISPLAYS, folder) and os.path.isdir(DISPLAYS):
                there = os.path.join(_below(number), os.path.relpath(DISPLAYS, folder))
                _mount(there, DISPLAYS, flags=MS_BIND)

    def _overlay(self, number: int, folder: str) -> None:
        """Mount a layer over a folder; paths are relative, so that they need no escaping."""
        upper, work = (os.path.join(self._name, str(number), each) for each in ("upper", "work"))
        for each in (upper, work):
            os.makedirs(each, exist_ok=True)
        of_folder = os.stat(folder)
        os.chmod(upper, stat.S_IMODE(of_folder.st_mode))
        os.utime(upper, ns=(of_folder.st_atime_ns, of_folder.st_mtime_ns))
        options = f"lowerdir={_below(number)},upperdir={upper},workdir={work}"
        _mount("overlay", folder, kind="overlay", options=options + self._options)


def private_of(given: dict[str, Any] | None) -> Private | None:
    """Return the file-system view for the given options; None for the real file system."""
    return None if given is None else Private(**given)


def _apart(folders: list[str]) -> Iterator[str]:
    """Yield the folders to overlay: the outermost ones that contain no other mount.

    Folders within another one of these need no layer of their own.
    """
    with open("/proc/self/mountinfo", encoding="utf-8", errors="surrogateescape") as file:
        points = [line.split()[MOUNTED].encode().decode("unicode_escape") for line in file]
    taken: list[str] = []
    for folder in sorted({os.path.realpath(each) for each in folders}):
        holds = folder == "/" or any(_is_in(point, folder) and point != folder for point in points)
        if not holds and os.path.isdir(folder) and not any(_is_in(folder, e) for e in taken):
            taken.append(folder)
            yield folder


def _is_in(path: str, folder: str) -> bool:
    return os.path.join(path, "").startswith(os.path.join(folder, ""))


def _below(number: int) -> str:
    """Return the path at which the folder under a layer is bind-mounted."""
    return os.path.join("below", str(number))


def _remove(path: str) -> None:
    """Remove a file, or a folder with all its contents, from the layer."""
    if not os.path.lexists(path):
        return
    if not os.path.isdir(path) or os.path.islink(path):
        os.unlink(path)
        return
    for at, folders, files in os.walk(path, topdown=False):
        for file in files:
            os.unlink(os.path.join(at, file))
        for folder in folders:
            inner = os.path.join(at, folder)
            (os.unlink if os.path.islink(inner) else os.rmdir)(inner)
    os.rmdir(path)


def _copy(source: str, target: str) -> None:
    """Copy the files of a layer, with links and deletion marks."""
    of_source = os.lstat(source)
    mode = of_source.st_mode
    if stat.S_ISDIR(mode):
        os.mkdir(target)
        for name in os.listdir(source):
            _copy(os.path.join(source, name), os.path.join(target, name))
    elif stat.S_ISLNK(mode):
        os.symlink(os.readlink(source), target)
    elif stat.S_ISREG(mode):
        with open(source, "rb") as read, open(target, "wb") as written:
            while os.sendfile(written.fileno(), read.fileno(), None, 1 << 30):
                pass
    elif stat.S_ISCHR(mode) or stat.S_ISFIFO(mode):  # a removed file is a device without a number
        os.mknod(target, mode, of_source.st_rdev)
    else:  # a socket, which nobody listens to
        return
    if not stat.S_ISLNK(mode):
        for name in (each for each in os.listxattr(source) if ".overlay." in each):
            os.setxattr(target, name, os.getxattr(source, name))
        os.chmod(target, stat.S_IMODE(mode))
        os.utime(target, ns=(of_source.st_atime_ns, of_source.st_mtime_ns))


# -- the kernel ------------------------------------------------------------------------------------


class _Attributes(ctypes.Structure):
    """Attributes that `mount_setattr` sets and clears (`linux/mount.h`)."""

    _fields_ = [
        ("set", ctypes.c_uint64),
        ("clear", ctypes.c_uint64),
        ("propagation", ctypes.c_uint64),
        ("namespace", ctypes.c_uint64),
    ]


def _called(name: str, *arguments: Any) -> int:
    """Call a function of the C library.

    Raises
    ------
    OSError
        If the function fails.
    """
    library = ctypes.CDLL(None, use_errno=True)
    result = int(getattr(library, name)(*arguments))
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{name}: {os.strerror(number)}")
    return result


def _unshare(flags: int) -> None:
    if not sys.platform.startswith("linux"):
        raise OSError("only Linux has private mounts")
    _called("unshare", flags)


def _mount(
    source: str, target: str, *, kind: str | None = None, flags: int = 0, options: str | None = None
) -> None:
    def encoded(text: str | None) -> bytes | None:
        return None if text is None else os.fsencode(text)

    texts = encoded(source), encoded(target), encoded(kind)
    _called("mount", *texts, ctypes.c_ulong(flags), encoded(options))


def _set_writable(path: str) -> None:
    _set_attributes(path, _Attributes(clear=MOUNT_ATTR_RDONLY), 0)


def _set_attributes(path: str, attributes: _Attributes, flags: int) -> None:
    at = os.fsencode(path)
    size = ctypes.sizeof(attributes)
    _called("syscall", MOUNT_SETATTR, AT_FDCWD, at, flags, ctypes.byref(attributes), size)


def _keep_capabilities(*, on: bool) -> None:
    """Enable the capabilities that the process's own namespace grants, or drop them.

    They would allow a user to read and write files whose modes forbid it. If the user is the
    system's administrator, all capabilities are kept.
    """
    if os.geteuid() == 0:
        return
    header = (ctypes.c_uint32 * 2)(CAPABILITIES_V3, 0)
    sets = (ctypes.c_uint32 * 6)()  # effective, permitted, inheritable; the low halves, the high
    _called("capget", header, sets)
    for half in (0, 3):
        sets[half] = sets[half + 1] if on else 0
    _called("capset", header, sets)


def main(options: str) -> None:
    """Enter a private view, to test whether the kernel supports it."""
    Private(**json.loads(options)).enter()

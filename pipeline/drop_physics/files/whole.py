"""Write files completely or not at all: they are written as `.part`, and renamed when finished.

An existing `.part` file is kept, and the next name is used: `NAME.2.part`.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from drop_physics.errors import OutputError
from drop_physics.files.outputs import (
    check_regular,
    check_target,
    free_part_of,
    output_errors,
    part_of,
)
from drop_physics.messages import Message


@contextlib.contextmanager
def written_whole(path: Path, *, force: bool, ours: bool = False) -> Iterator[BinaryIO]:
    """Yield a binary file to write and read, which gets its name if the block succeeds.

    Parameters
    ----------
    path, force, ours
        Passed on to `files.whole.replaced`.

    Raises
    ------
    OutputError
        For the reasons of `replaced`; an existing file is then unchanged.
    """
    with replaced(path, force=force, ours=ours) as part, part.open("w+b") as handle:
        yield handle


@contextlib.contextmanager
def replaced(path: Path, *, force: bool, ours: bool = False) -> Iterator[Path]:
    """Yield a `.part` file for another program to write; it gets its name when the block ends.

    Parameters
    ----------
    path
        The file to write.
    force
        Whether an existing file, or an existing `.part` file, may be replaced.
    ours
        Whether an existing file is known to be drop's own, and may be replaced without `force`.

    Raises
    ------
    OutputError
        For the reasons of `check_target`; or if another process is writing the same file, there are
        too many unfinished files, or the disk is full.
    """
    check_target(path, force=force or ours)
    with output_errors(path), growing(path, force=force) as part:
        try:
            yield part
            onto_disk([part])
            renamed(part, path, force=force or ours)
        except BaseException:
            part.unlink(missing_ok=True)
            raise


def onto_disk(paths: Iterable[Path]) -> None:
    """Flush files to disk, so that they survive a power failure.

    Raises
    ------
    OutputError
        If a file cannot be written to the disk.
    """
    for path in paths:
        with output_errors(path), path.open("rb+") as handle:
            os.fsync(handle.fileno())


def renamed(part: Path, path: Path, *, force: bool) -> None:
    """Give a finished file its final name; replace an existing file only with `force`.

    Raises
    ------
    OutputError
        If another process has created a file of that name in the meantime.
    """
    if force:
        part.replace(path)
        return
    try:
        path.hardlink_to(part)  # unlike a rename, never replaces a file
    except FileExistsError:
        raise OutputError(
            "{path} was created by another process and is left as it is; give another name, or "
            "--force",
            path=path,
        ) from None
    except OSError:  # a file system without hard links
        part.replace(path)
    else:
        part.unlink()


@contextlib.contextmanager
def growing(path: Path, *, force: bool) -> Iterator[Path]:
    """Yield a new empty file that only this process writes to.

    The process locks the first `.part` name, whatever that file contains, and writes to the first
    free name. An empty file counts as free, since `reserved` creates such files.
    """
    first = part_of(path)
    while True:
        with opened(first) as handle:
            lock(
                handle,
                Message("another process is writing {path}; wait, or give another name", path=path),
            )
            there = os.fstat(handle.fileno())
            # Its writer may have finished and renamed it after we opened it, before we locked it.
            if not (first.exists() and os.path.samestat(first.stat(), there)):
                continue
            if force and there.st_nlink > 1:
                # A second name of a finished file: a run was killed while it gave its recording the
                # final name. We must not write to that file.
                first.unlink()
                continue
            if force:
                handle.truncate(0)
            elif there.st_size or there.st_nlink > 1:
                free = free_part_of(path)
                free.touch(exist_ok=False)
                yield free
                return
            yield first
            return


def opened(path: Path) -> BinaryIO:
    """Open a file for appending, creating it if needed; links are not followed.

    Raises
    ------
    OutputError
        If the name belongs to anything other than a regular file.
    """
    check_regular(path)
    # If a link or a pipe appears there just now, opening fails: it is not followed or waited for.
    careful = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    return open(path, "ab", opener=lambda name, flags: os.open(name, flags | careful, 0o666))


def lock(handle: BinaryIO, refusal: Message) -> None:
    """Lock an open file against other processes until it is closed.

    Raises
    ------
    OutputError
        With `refusal`, if another process has locked it.
    """
    try:
        import fcntl
    except ImportError:  # Windows: there, two writers of one file are not detected
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise OutputError(refusal) from None

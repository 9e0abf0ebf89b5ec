"""Files that are whole or not there: they grow as `.part`, and are renamed.

A `.part` that was there before stays as it is: the next name is taken, `NAME.2.part`.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from pipeline.errors import OutputError
from pipeline.files.outputs import check_regular, check_target, free_part_of, part_of, translated


@contextlib.contextmanager
def written_whole(path: Path, *, force: bool, ours: bool = False) -> Iterator[BinaryIO]:
    """Yield a binary file, to write and read, that has its name once the block ends without error.

    Parameters
    ----------
    path, force, ours
        As for `replaced`.

    Raises
    ------
    OutputError
        As for `replaced`. What was there before is untouched then.
    """
    with replaced(path, force=force, ours=ours) as part, part.open("w+b") as handle:
        yield handle


@contextlib.contextmanager
def replaced(path: Path, *, force: bool, ours: bool = False) -> Iterator[Path]:
    """Yield a `.part` file, for another program to write; it gets its name when the block ends.

    Parameters
    ----------
    path
        The file to write.
    force
        Whether what is there may be replaced, under the file's own name and as its `.part`.
    ours
        Whether what has the file's own name is known to be ours, and may be replaced without that.

    Raises
    ------
    OutputError
        As `check_target`; if another process is writing the same file; if too many unfinished
        ones are there; if the disk is full.
    """
    check_target(path, force=force or ours)
    with translated(path), growing(path, force=force) as part:
        try:
            yield part
            onto_disk([part])
            renamed(part, path, force=force or ours)
        except BaseException:
            part.unlink(missing_ok=True)
            raise


def onto_disk(paths: Iterable[Path]) -> None:
    """Wait until files are on the disk, so that they outlive a power failure.

    Raises
    ------
    OutputError
        If one cannot be written there.
    """
    for path in paths:
        with translated(path), path.open("rb+") as handle:
            os.fsync(handle.fileno())


def renamed(part: Path, path: Path, *, force: bool) -> None:
    """Give a finished file its name; what is there is replaced with `force` only.

    Raises
    ------
    OutputError
        If another process made a file of that name meanwhile.
    """
    if force:
        part.replace(path)
        return
    try:
        path.hardlink_to(part)  # unlike a rename, never replaces a file that came in between
    except FileExistsError:
        raise OutputError(
            f"{path} was created by another process and is left as it is; give another name, or "
            "--force"
        ) from None
    except OSError:  # a file system without hard links
        part.replace(path)
    else:
        part.unlink()


@contextlib.contextmanager
def growing(path: Path, *, force: bool) -> Iterator[Path]:
    """Yield an empty file of our own, for a file that is not whole yet.

    Whoever writes a file holds the first of its `.part` names, whatever is there, and writes to the
    first at which nothing was. An empty one is nothing: `reserved` takes a name with it.
    """
    first = part_of(path)
    while True:
        with opened(first) as handle:
            lock(handle, f"another process is writing {path}; wait, or give another name")
            there = os.fstat(handle.fileno())
            # Between our opening it and locking it, its writer may have finished and renamed it.
            if not (first.exists() and os.path.samestat(first.stat(), there)):
                continue
            if force and there.st_nlink > 1:
                # It is a whole file by another name, as where a run was killed while it gave its
                # recording the final one. What we write must not go in there.
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
    """Open a file of ours to append to; made if missing, and no link is followed.

    Raises
    ------
    OutputError
        If something else than a regular file has its name.
    """
    check_regular(path)
    # Who puts a link or a pipe there just now gets an error: it is not followed or waited for.
    careful = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    return open(path, "ab", opener=lambda name, how: os.open(name, how | careful, 0o666))


def lock(handle: BinaryIO, refusal: str) -> None:
    """Hold an open file against other processes until it is closed.

    Raises
    ------
    OutputError
        With `refusal`, if another one holds it.
    """
    try:
        import fcntl
    except ImportError:  # Windows: two writers of one file are not told apart there
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise OutputError(refusal) from None

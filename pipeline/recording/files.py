"""Files that are whole or not there: `.part`, verify, rename.

Nothing here knows physics. A recording grows as `RUN.rrd.part`; every other output is written the
same way through `written_whole`. A `.part` that was there before stays as it is: the next name is
taken, `RUN.rrd.2.part`.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from pipeline.errors import OutputError
from pipeline.recording import rrd
from pipeline.recording.outputs import (
    check_regular,
    check_target,
    free_part_of,
    part_of,
    sealed_of,
    translated,
)
from pipeline.recording.viewer import binary


@contextlib.contextmanager
def unfinished(
    path: Path,
    *,
    force: bool,
    ours: bool = False,
    salvage: bool = True,
    note: Callable[[str], None] = lambda _: None,
) -> Iterator[Path]:
    """Yield the `.part` file of a recording, locked against a second writer.

    Parameters
    ----------
    path, force, ours
        As for `replaced`.
    salvage
        Whether what was written until an error is kept.
    note
        Told in a sentence if the file has another name than usual until it is whole.

    Raises
    ------
    OutputError
        As for `replaced`; if something is where the viewer's layout is to be added.
    """
    check_target(path, force=force or ours)
    with translated(path), _part(path, force=force) as part:
        try:
            if part != (first := part_of(path)):
                note(f"{first} was there and is left as it is; this recording grows as {part}")
            _make_way(sealed_of(part), force=force)
            with translated(path):
                yield part
        except BaseException as failure:
            with contextlib.suppress(OSError):  # its folder may be gone
                if salvage and _holds_something(part):
                    failure.add_note(f"what was recorded until then is in {part}")
                else:
                    part.unlink()
            raise


def _make_way(sealed: Path, *, force: bool) -> None:
    if os.path.lexists(sealed) and not force:
        raise OutputError(f"{sealed} is in the way, and is left as it is; move it, or --force")
    sealed.unlink(missing_ok=True)


def _holds_something(part: Path) -> bool:
    """Whether at least one chunk of a recording was written whole."""
    try:
        return any(True for _ in rrd.chunks(part, unfinished=True))
    except rrd.DamagedError:
        return False


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
    with translated(path), _part(path, force=force) as part:
        try:
            yield part
            onto_disk([part])
            _rename(part, path, force=force or ours)
        except BaseException:
            part.unlink(missing_ok=True)
            raise


def pack(recording: Path, path: Path) -> None:
    """Write a recording again in as few bytes as Rerun can: its many small chunks in a few.

    The whole recording is in memory meanwhile.
    """
    _rerun("rrd", "optimize", recording, "-o", path)


def seal(
    part: Path, path: Path, *, blueprint: Path | None, rows: Mapping[str, int], force: bool
) -> None:
    """Give a finished recording its name: add the viewer's layout, verify, rename.

    Without a layout it is one of very many. The file is as Rerun's writer left it, and is verified
    by reading all of it back in this process: starting Rerun's own verifier takes 12 ms, the fall
    one. Nor is it waited for until it is on the disk; `onto_disk` does that for all of them.

    Parameters
    ----------
    part, path
        The finished `.part` file and the name it is to have.
    blueprint
        A viewer layout (.rbl) to go into the file, or None.
    rows
        Rows that each entity must have.
    force
        Whether a file of that name may be replaced.

    Raises
    ------
    OutputError
        If the file does not verify; the `.part` file stays, of what was made of it nothing does.
    """
    if blueprint is None:
        _check_rows(part, path, rows)
        _rename(part, path, force=force)
        return
    whole = sealed_of(part)
    try:
        # `route` copies messages without decoding them: 0.1 s and flat memory for 300 MB, where
        # `merge` loads everything. It writes into a file that we made: where Ctrl-C comes
        # while it is started, it lives a moment longer, and makes no file by that name again.
        with whole.open("xb") as made:
            _rerun("rrd", "route", part, blueprint, stdout=made)
        # `verify` exits 0 on an empty file too, so its sentence and the row counts are asked for.
        if "1 file verified" not in _rerun("rrd", "verify", whole):
            raise OutputError(f"what was written for {path} does not verify; run it again")
        _check_rows(whole, path, rows)
        onto_disk([whole])
        _rename(whole, path, force=force)
        part.unlink(missing_ok=True)
    except FileExistsError:  # somebody else's, come meanwhile
        raise
    except BaseException:
        whole.unlink(missing_ok=True)
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


def _check_rows(written: Path, path: Path, rows: Mapping[str, int]) -> None:
    from rerun.chunk import RrdReader

    counted: dict[str, int] = {}
    for line in RrdReader(written).store().summary().splitlines():
        entity, count = line.split(" ")[:2]
        counted[entity] = counted.get(entity, 0) + int(count.removeprefix("rows="))
    if counted != dict(rows):
        raise OutputError(f"what was written for {path} lacks rows; run it again")


def _rerun(*arguments: str | Path, stdout: BinaryIO | int = subprocess.PIPE) -> str:
    """Run Rerun's command line, and return its words; a path is never taken for an option."""
    done = subprocess.run(
        [binary(), *(one.absolute() if isinstance(one, Path) else one for one in arguments)],
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    words = (done.stdout or "") + done.stderr
    if done.returncode != 0:
        raise RuntimeError(f"rerun {arguments[0]} {arguments[1]}: {words.strip()[-300:]}")
    return words


def _rename(part: Path, path: Path, *, force: bool) -> None:
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
def _part(path: Path, *, force: bool) -> Iterator[Path]:
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

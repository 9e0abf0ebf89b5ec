"""Files that are whole or not there: `.part`, verify, rename.

Nothing here knows physics. A recording grows as `RUN.rrd.part`; every other output is written the
same way through `written_whole`.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from pipeline.errors import OutputError
from pipeline.recording.viewer import binary


def part_of(path: Path) -> Path:
    """Return the name a file has until it is whole."""
    return path.with_name(path.name + ".part")


def is_part(path: Path) -> bool:
    """Whether a name is that of a file which may not be whole."""
    return path.name.endswith(".part")


def check_target(path: Path, *, force: bool) -> None:
    """Make sure a file can be written, before any work is done for it.

    Raises
    ------
    OutputError
        If it exists and `force` is not given, is no plain file, or its folder is missing or
        read-only.
    """
    folder = path.parent
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise OutputError(f"{str(path)!r} must be UTF-8: Rerun takes no other names") from None
    with _translated(path):
        if path.is_dir():
            raise OutputError(f"{path} is a folder; name a file in it, such as {path / 'run.rrd'}")
        if path.exists() and not path.is_file():  # a rename would put a file in a device's place
            raise OutputError(f"{path} is no plain file; give another name")
        if path.exists() and not force:
            raise OutputError(f"{path} exists and is left as it is; give another name, or --force")
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder} is a file, not a folder; give another name")
        if not folder.is_dir():
            raise OutputError(
                f"the folder {folder} does not exist; make it with: mkdir -p '{folder}'"
            )
        if not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(f"the folder {folder} cannot be written to; choose another one")


def check_room(path: Path, needed_bytes: int) -> None:
    """Make sure that a file has room on its disk, before any work is done for it.

    Raises
    ------
    OutputError
        If it has not.
    """
    free = shutil.disk_usage(path.parent).free
    if needed_bytes > free:
        raise OutputError(
            f"{path} needs some {needed_bytes / 1e9:.3g} GB on the disk while it is written, and "
            f"{free / 1e9:.3g} GB are free; make room, or record fewer steps"
        )


@contextlib.contextmanager
def unfinished(path: Path, *, force: bool) -> Iterator[Path]:
    """Yield the `.part` file of a recording, locked against a second writer.

    Raises
    ------
    OutputError
        As `check_target`; if another process is writing the same file; if the disk is full.
    """
    check_target(path, force=force)
    part = part_of(path)
    with _translated(path), _locked(part, path):
        try:
            with _translated(path):
                yield part
        except BaseException as failure:
            with contextlib.suppress(FileNotFoundError):  # its folder may be gone
                if part.stat().st_size:
                    failure.add_note(f"what was recorded until then is in {part}")
                else:
                    part.unlink()
            raise


@contextlib.contextmanager
def written_whole(path: Path, *, force: bool = True) -> Iterator[BinaryIO]:
    """Yield a binary file that gets its name when the block ends without an error.

    Raises
    ------
    OutputError
        As `check_target`; if another process is writing the same file; if the disk is full. What
        was there before is untouched then.
    """
    with replaced(path, force=force) as part, part.open("wb") as handle:
        yield handle


@contextlib.contextmanager
def replaced(path: Path, *, force: bool = True) -> Iterator[Path]:
    """Yield a `.part` file, for another program to write; it gets its name when the block ends.

    Raises
    ------
    OutputError
        As for `written_whole`.
    """
    check_target(path, force=force)
    part = part_of(path)
    with _translated(path), _locked(part, path):
        try:
            yield part
            onto_disk([part])
            _rename(part, path, force=force)
        finally:
            part.unlink(missing_ok=True)


def pack(recording: Path, path: Path) -> None:
    """Write a recording again in as few bytes as Rerun can: its many small chunks in a few.

    The whole recording is in memory meanwhile.
    """
    _rerun("rrd", "optimize", str(recording), "-o", str(path))


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
        If the file does not verify; the `.part` file stays.
    """
    if blueprint is None:
        _check_rows(part, rows)
        _rename(part, path, force=force)
        return
    whole = part.with_name(part.name + ".sealed")
    try:
        # `route` copies messages without decoding them: 0.1 s and flat memory for 300 MB, where
        # `merge` loads everything.
        _rerun("rrd", "route", str(part), str(blueprint), "-o", str(whole))
        _verify(whole)
        _check_rows(whole, rows)
        onto_disk([whole])
        _rename(whole, path, force=force)
        part.unlink(missing_ok=True)
    finally:
        whole.unlink(missing_ok=True)


def onto_disk(paths: Iterable[Path]) -> None:
    """Wait until files are on the disk, so that they outlive a power failure.

    Raises
    ------
    OutputError
        If one cannot be written there.
    """
    for path in paths:
        with _translated(path), path.open("rb+") as handle:
            os.fsync(handle.fileno())


def _verify(path: Path) -> None:
    # `verify` exits 0 on an empty file too, so its sentence and the row counts are asked for.
    if "1 file verified" not in _rerun("rrd", "verify", str(path)):
        raise OutputError(f"{path} does not verify; it stays for inspection, run the command again")


def _check_rows(path: Path, rows: Mapping[str, int]) -> None:
    from rerun.chunk import RrdReader

    counted: dict[str, int] = {}
    for line in RrdReader(path).store().summary().splitlines():
        entity, count = line.split(" ")[:2]
        counted[entity] = counted.get(entity, 0) + int(count.removeprefix("rows="))
    if counted != dict(rows):
        raise OutputError(f"{path} lacks rows that were written; run the command again")


def _rerun(*arguments: str) -> str:
    """Run Rerun's command line, and return its words."""
    done = subprocess.run(
        [binary(), *arguments],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    words = done.stdout + done.stderr
    if done.returncode != 0:
        raise RuntimeError(f"rerun {' '.join(arguments[:2])}: {words.strip()[-300:]}")
    return words


def _rename(part: Path, path: Path, *, force: bool) -> None:
    if force:
        part.replace(path)
        return
    try:
        path.hardlink_to(part)  # unlike a rename, never replaces a file that came in between
    except FileExistsError:
        raise OutputError(f"{path} was made by somebody else meanwhile; {part} stays") from None
    except OSError:  # a file system without hard links
        part.replace(path)
    else:
        part.unlink()


@contextlib.contextmanager
def _locked(part: Path, path: Path) -> Iterator[None]:
    """Hold the `.part` file against other processes."""
    while True:
        with part.open("ab") as handle:
            lock(handle, f"another process is writing {path}; wait, or give another name")
            # Between our opening it and locking it, its writer may have finished and renamed it.
            if part.exists() and os.path.samestat(part.stat(), os.fstat(handle.fileno())):
                yield
                return


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


@contextlib.contextmanager
def _translated(path: Path) -> Iterator[None]:
    """Turn what the system and Rerun say of a failed write into one line of ours."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{error.filename or path} cannot be written: {reason}") from error
    except RuntimeError as error:  # Rerun's writer, and its command line
        found = re.search(r"([\w ]+) \(os error \d+\)", str(error))
        if found is None:
            raise
        reason = found[1].strip()
        what = f"{path} cannot be written: {reason}"
        raise OutputError(f"{what}; make room there, or choose another folder") from error

"""Files that are whole or not there: `.part`, verify, rename.

Nothing here knows physics. A recording grows as `RUN.rrd.part`; every other output is written the
same way through `written_whole`.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from pipeline.errors import OutputError


def part_of(path: Path) -> Path:
    """Return the name a file has until it is whole."""
    return path.with_name(path.name + ".part")


def check_target(path: Path, *, force: bool) -> None:
    """Make sure a file can be written, before any work is done for it.

    Raises
    ------
    OutputError
        If it exists and `force` is not given, is a folder, or its folder is missing or read-only.
    """
    folder = path.parent
    if path.is_dir():
        raise OutputError(f"{path} is a folder; name a file in it, such as {path / 'run.rrd'}")
    if path.exists() and not force:
        raise OutputError(f"{path} exists and is left as it is; give another name, or --force")
    if not folder.is_dir():
        raise OutputError(f"the folder {folder} does not exist; make it with: mkdir -p '{folder}'")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"the folder {folder} cannot be written to; choose another one")


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
    with _translated(path), part.open("ab") as handle:
        _lock(handle, path)
        try:
            yield part
        except BaseException as failure:
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
        As `check_target`; if the disk is full. What was there before is untouched then.
    """
    check_target(path, force=force)
    part = part_of(path)
    with _translated(path):
        try:
            with part.open("wb") as handle:
                yield handle
                handle.flush()
                os.fsync(handle.fileno())
            _rename(part, path, force=force)
        finally:
            part.unlink(missing_ok=True)


def seal(
    part: Path, path: Path, *, blueprint: Path | None, rows: Mapping[str, int], force: bool
) -> None:
    """Give a finished recording its name: add the viewer's layout, verify, rename.

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
    whole = part
    if blueprint is not None:
        whole = part.with_name(part.name + ".sealed")
    try:
        if blueprint is not None:
            # `route` copies messages without decoding them: 0.1 s and flat memory for 300 MB,
            # where `merge` loads everything.
            _rerun("rrd", "route", str(part), str(blueprint), "-o", str(whole))
        _verify(whole, rows)
        with whole.open("rb+") as handle:
            os.fsync(handle.fileno())
        _rename(whole, path, force=force)
        part.unlink(missing_ok=True)
    finally:
        if whole != part:
            whole.unlink(missing_ok=True)


def _verify(path: Path, rows: Mapping[str, int]) -> None:
    from rerun.chunk import RrdReader

    # `verify` exits 0 on an empty file too, so its sentence and the row counts are asked for.
    if "1 file verified" not in _rerun("rrd", "verify", str(path)):
        raise OutputError(f"{path} does not verify; it stays for inspection, run the command again")
    counted: dict[str, int] = {}
    for line in RrdReader(path).store().summary().splitlines():
        entity, count = line.split(" ")[:2]
        counted[entity] = counted.get(entity, 0) + int(count.removeprefix("rows="))
    if counted != dict(rows):
        raise OutputError(f"{path} lacks rows that were written; run the command again")


def _rerun(*arguments: str) -> str:
    """Run Rerun's own binary (the `rerun` on the PATH is a slower wrapper); return its words."""
    spec = importlib.util.find_spec("rerun_cli")
    if spec is None or spec.origin is None:
        raise OutputError("rerun-sdk's command line is not installed; try: pip install rerun-sdk")
    binary = Path(spec.origin).parent / "rerun"
    done = subprocess.run(
        [binary, *arguments], capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False
    )
    words = done.stdout + done.stderr
    if done.returncode != 0:
        raise OutputError(f"rerun {' '.join(arguments[:2])} failed: {words.strip()[-300:]}")
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


def _lock(handle: BinaryIO, path: Path) -> None:
    try:
        import fcntl
    except ImportError:  # Windows: two writers of one file are not told apart there
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        raise OutputError(
            f"another process is writing {path}; wait, or give another name"
        ) from None


@contextlib.contextmanager
def _translated(path: Path) -> Iterator[None]:
    """Turn what the system and Rerun say of a failed write into one line of ours."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}") from error
    except RuntimeError as error:  # Rerun's writer
        if "os error" not in str(error):
            raise
        raise OutputError(f"{path} cannot be written: {error}; make room and try again") from error

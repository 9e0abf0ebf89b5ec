"""Files that are whole or not there: `.part`, verify, rename.

Nothing here knows physics. A recording grows as `RUN.rrd.part`; every other output is written the
same way through `written_whole`.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import stat
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

from pipeline.errors import OutputError
from pipeline.recording.viewer import binary


def part_of(path: Path) -> Path:
    """Return the name a file has until it is whole."""
    return path.with_name(path.name + ".part")


def _sealed_of(part: Path) -> Path:
    """Return the name of the copy of a finished `.part` file that the viewer's layout goes into."""
    return part.with_name(part.name + ".sealed")


def is_part(path: Path) -> bool:
    """Whether a name is that of a file which may not be whole."""
    return path.name.endswith(".part")


def check_target(path: Path, *, force: bool) -> None:
    """Make sure a file can be written, before any work is done for it.

    Raises
    ------
    OutputError
        If it exists and `force` is not given, is not a regular file, or its folder is missing or
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
            raise OutputError(f"{path} is not a regular file; give another name")
        if os.path.lexists(path) and not force:  # a link that leads nowhere exists, too
            raise OutputError(f"{path} exists and is left as it is; give another name, or --force")
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder} is a file, not a folder; give another name")
        _check_home(folder)
        if not folder.is_dir():
            raise OutputError(
                f"the folder {folder} does not exist; make it with: mkdir -p '{folder}'"
            )
        if not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(f"the folder {folder} cannot be written to; choose another one")
        _check_regular(part_of(path))


def check_apart(outputs: Sequence[Path], *, inputs: Sequence[Path]) -> None:
    """Make sure that no output is an input or another output, by whatever name or link.

    Raises
    ------
    OutputError
        If writing one would replace what the same command reads or writes.
    """
    taken = [(path, "reads") for path in inputs]
    for output in outputs:
        part = part_of(output)
        names = (output, part, _sealed_of(part))  # all that it has until it is whole
        for other, does in taken:
            if any(_is_same(name, other) for name in names):
                raise OutputError(
                    f"writing {output} would replace {other}, which the same command {does}; "
                    "give another name"
                )
        taken += [(name, "writes") for name in names]


def _is_same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:  # one of them does not exist
        return os.path.realpath(one) == os.path.realpath(other)


def check_kind(path: Path, beginning: bytes) -> None:
    """Make sure that an output nobody named replaces only a file that begins like its own kind.

    Raises
    ------
    OutputError
        If another kind of file has its name.
    """
    with _translated(path), contextlib.suppress(FileNotFoundError), path.open("rb") as file:
        if file.read(len(beginning)) != beginning:
            raise refused(path)


def refused(path: Path) -> OutputError:
    """Return the error for a file that has an output's default name and is something else."""
    return OutputError(
        f"{path} is not what drop writes under that name, and is left as it is; rename it, give "
        "the output another name, or --force"
    )


def reserved(path: Path) -> bool:
    """Take a free name, by an empty `.part` file; False where another process was faster.

    Raises
    ------
    OutputError
        If the folder cannot be written to.
    """
    with _translated(path):
        try:
            part_of(path).touch(exist_ok=False)
        except FileExistsError:
            return False
    return True


def make_folder(path: Path, option: str) -> None:
    """Make a folder for outputs where it is missing, and those above it.

    Raises
    ------
    OutputError
        If it cannot be made; the message names the option it was given with.
    """
    _check_home(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, UnicodeEncodeError) as error:
        reason = getattr(error, "strerror", None) or "its name is not UTF-8"
        raise OutputError(
            f"the folder {path!s} cannot be made: {reason}; choose another with {option}"
        ) from None


def _check_home(folder: Path) -> None:
    """Make sure that no folder called `~` comes about: shells leave the one in `--out=~/x` alone.

    Raises
    ------
    OutputError
        If the folder lies in somebody's home, and in no folder here that is called so.
    """
    home = os.path.expanduser(folder)  # noqa: PTH111 - unlike pathlib's it never fails
    if home != str(folder) and not Path(folder.parts[0]).exists():
        raise OutputError(f"the shell did not expand the ~ in {folder}; write {home} instead")


def _check_regular(path: Path) -> None:
    """Make sure that a file of ours would not be written through a link, or into a pipe.

    Raises
    ------
    OutputError
        If something else has its name.
    """
    if os.path.lexists(path) and not stat.S_ISREG(path.lstat().st_mode):
        raise OutputError(f"{path} is not a regular file, and in the way; remove it")


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
    whole = _sealed_of(part)
    whole.unlink(missing_ok=True)  # of a run that was killed, or a link that would be followed
    try:
        # `route` copies messages without decoding them: 0.1 s and flat memory for 300 MB, where
        # `merge` loads everything.
        _rerun("rrd", "route", part, blueprint, "-o", whole)
        # `verify` exits 0 on an empty file too, so its sentence and the row counts are asked for.
        if "1 file verified" not in _rerun("rrd", "verify", whole):
            raise OutputError(f"what was written for {path} does not verify; run it again")
        _check_rows(whole, path, rows)
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


def _check_rows(written: Path, path: Path, rows: Mapping[str, int]) -> None:
    from rerun.chunk import RrdReader

    counted: dict[str, int] = {}
    for line in RrdReader(written).store().summary().splitlines():
        entity, count = line.split(" ")[:2]
        counted[entity] = counted.get(entity, 0) + int(count.removeprefix("rows="))
    if counted != dict(rows):
        raise OutputError(f"what was written for {path} lacks rows; run it again")


def _rerun(*arguments: str | Path) -> str:
    """Run Rerun's command line, and return its words; a path is never taken for an option."""
    done = subprocess.run(
        [binary(), *(one.absolute() if isinstance(one, Path) else one for one in arguments)],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    words = done.stdout + done.stderr
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
def _locked(part: Path, path: Path) -> Iterator[None]:
    """Hold the `.part` file against other processes."""
    while True:
        with opened(part) as handle:
            lock(handle, f"another process is writing {path}; wait, or give another name")
            # Between our opening it and locking it, its writer may have finished and renamed it.
            if part.exists() and os.path.samestat(part.stat(), os.fstat(handle.fileno())):
                if part.stat().st_nlink == 1:
                    yield
                    return
                # It is a whole file by another name, as where a run was killed while it gave its
                # recording the final one. What we write must not go in there.
                part.unlink()


def opened(path: Path) -> BinaryIO:
    """Open a file of ours to append to; made if missing, and no link is followed.

    Raises
    ------
    OutputError
        If something else than a regular file has its name.
    """
    _check_regular(path)
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

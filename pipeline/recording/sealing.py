"""How a recording is finished: it grows as `.part`, gets its layout, is verified and renamed."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from pipeline.errors import OutputError
from pipeline.files.outputs import check_target, part_of, sealed_of, translated
from pipeline.files.whole import growing, onto_disk, renamed
from pipeline.recording import rrd
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
    with translated(path), growing(path, force=force) as part:
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


def pack(recording: Path, path: Path) -> None:
    """Write a recording again in as few bytes as Rerun can: its many small chunks in a few.

    The whole recording is in memory meanwhile.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    _rerun("rrd", "optimize", recording, "-o", path)
    _check_end(path, path)


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
        renamed(part, path, force=force)
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
        renamed(whole, path, force=force)
        part.unlink(missing_ok=True)
    except FileExistsError:  # somebody else's, come meanwhile
        raise
    except BaseException:
        whole.unlink(missing_ok=True)
        raise


def _check_end(written: Path, path: Path) -> None:
    """Check that nothing cut a file off: on a full disk Rerun's command line may not notice."""
    if not rrd.is_whole(written):
        raise OutputError(
            f"{path} cannot be written: its end is missing; make room there, or choose another "
            "folder"
        )


def _check_rows(written: Path, path: Path, rows: Mapping[str, int]) -> None:
    from rerun.chunk import RrdReader

    _check_end(written, path)
    counted: dict[str, int] = {}
    for line in RrdReader(written).store().summary().splitlines():
        entity, count = line.split(" ")[:2]
        counted[entity] = counted.get(entity, 0) + int(count.removeprefix("rows="))
    if counted != dict(rows):
        raise OutputError(f"what was written for {path} lacks rows; run it again")


def _rerun(*arguments: str | Path, stdout: BinaryIO | int = subprocess.PIPE) -> str:
    """Run Rerun's command line, and return its words; a path is never taken for an option."""
    done = subprocess.run(
        [
            binary(),
            *(
                argument.absolute() if isinstance(argument, Path) else argument
                for argument in arguments
            ),
        ],
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    words = (done.stdout or "") + done.stderr
    if done.returncode < 0:  # as of a limit on a file's size: it says nothing then
        name = signal.Signals(-done.returncode).name
        raise OutputError(
            f"rerun {arguments[0]} {arguments[1]} was ended by {name}; is there room for its file?"
        )
    if done.returncode != 0:
        raise RuntimeError(f"rerun {arguments[0]} {arguments[1]}: {words.strip()[-300:]}")
    return words

"""Finishes a recording: adds its layout, verifies it, and renames it from `.part`."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from drop_physics.errors import OutputError
from drop_physics.files.outputs import check_target, output_errors, part_of, sealed_of, unwritable
from drop_physics.files.whole import growing, onto_disk, renamed
from drop_physics.messages import Message
from drop_physics.recording import rrd, schema
from drop_physics.recording.viewer import binary
from drop_physics.temporary import is_temporary

PANIC = re.compile(r"panicked at '?(.+?)'?$", re.MULTILINE)
"""Text that Rerun's command line prints if it fails for another reason than a bad file."""


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
        Passed on to `files.whole.replaced`.
    salvage
        Whether data written before an error are kept.
    note
        A function that is called with a sentence if the `.part` file has to get another name than
        usual.

    Raises
    ------
    OutputError
        For the reasons of `replaced`, or if another file has the temporary name under which the
        recording is copied to add the viewer's layout.
    """
    check_target(path, force=force or ours)
    force = force or (ours and not salvage)  # what a killed run left of it is nobody's
    with output_errors(path), growing(path, force=force) as part:
        ours_at = part.stat()
        try:
            if part != (first := part_of(path)):
                note(
                    Message(
                        "{first} exists and is left as it is; this recording grows as {part}",
                        first=first,
                        part=part,
                    )
                )
            _make_way(sealed_of(part), force=force)
            with output_errors(path):
                yield part
        except BaseException as failure:
            with contextlib.suppress(OSError):  # its folder may be gone
                if not os.path.samestat(part.stat(), ours_at):
                    pass  # somebody else's: it has taken the name
                elif salvage and not is_temporary(part) and _holds_something(part):
                    failure.add_note(Message("what had been recorded is in {part}", part=part))
                else:
                    part.unlink()
            raise


def _make_way(sealed: Path, *, force: bool) -> None:
    if os.path.lexists(sealed) and not force:
        raise OutputError(
            "{path} is in the way and is left as it is; move it, or --force", path=sealed
        )
    sealed.unlink(missing_ok=True)


def _holds_something(part: Path) -> bool:
    """Return whether a file has at least one complete chunk of a simulation."""
    try:
        chunks = rrd.chunks(part, unfinished=True)
        return any(chunk.entity.startswith(schema.HAPPENED) for chunk in chunks)
    except rrd.DamagedError:
        return False


def pack(recording: Path, path: Path) -> None:
    """Rewrite a recording as small as Rerun can, by merging its chunks.

    This needs memory for the whole recording.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    _rerun("rrd", "optimize", recording, "-o", path)
    _check_end(path, path)


def seal(
    part: Path,
    path: Path,
    *,
    blueprint: Path | None,
    on_top: bool = False,
    rows: Mapping[str, int] | None,
    force: bool,
) -> None:
    """Give a finished recording its final name: add the viewer's layout, verify, rename.

    The file is verified by reading it back as a whole in this process, which takes less time and
    memory than Rerun's own verifier. A recording without a layout is one of many, and not flushed
    to the disk here: `onto_disk` does that for all of them.

    Parameters
    ----------
    part, path
        The finished `.part` file and its final name.
    blueprint
        A viewer layout (.rbl) to add to the file, or None.
    on_top
        Whether the file will be opened together with a recording, to replace the recording's
        layout. The viewer loads both files at the same time and keeps the layout that arrives last:
        so a recording begins with its layout, and a file on top of it ends with its layout.
    rows
        Number of rows that each entity must have; None to verify only the end of the file.
    force
        Whether an existing file may be replaced.

    Raises
    ------
    OutputError
        If the verification fails; the `.part` file is kept, the copy with the layout is deleted.
    """
    if blueprint is None:
        _check(part, path, part, rows)
        renamed(part, path, force=force)
        return
    whole = sealed_of(part)
    try:
        # `route` copies messages without decoding them: 0.1 s and flat memory for 300 MB, where
        # `merge` loads everything. It writes into a file that we created: if Ctrl-C interrupts its
        # start, it lives a moment longer than we do, but does not create that file again.
        with whole.open("xb") as copy:
            parts = (part, blueprint) if on_top else (blueprint, part)
            _rerun("rrd", "route", *parts, stdout=copy)
        _check(whole, path, part, rows)
        onto_disk([whole])
        renamed(whole, path, force=force)
        part.unlink(missing_ok=True)
    except FileExistsError:  # created by another process in the meantime
        raise
    except (RuntimeError, ValueError) as error:  # what Rerun finds in the file
        whole.unlink(missing_ok=True)
        if "os error" in str(error):
            raise
        raise _unverified(path, part) from error
    except BaseException:
        whole.unlink(missing_ok=True)
        raise


def _unverified(path: Path, part: Path) -> OutputError:
    return OutputError(
        "what was written for {path} does not verify; run it again, under another name if "
        "something else writes to {part}",
        path=path,
        part=part,
    )


def _check_end(written: Path, path: Path) -> None:
    """Check that a file was not cut off: Rerun's command line may miss that the disk is full."""
    if not rrd.is_whole(written):
        raise unwritable(path, Message("its end is missing"))


def _check(written: Path, path: Path, part: Path, rows: Mapping[str, int] | None) -> None:
    """Check that a file is complete, that each chunk can be decoded, and that no row is missing."""
    _check_end(written, path)
    if rows is None:
        return
    counted: dict[str, int] = {}
    try:
        for chunk in rrd.chunks(written):
            entity = f"/{chunk.entity}"
            counted[entity] = counted.get(entity, 0) + chunk.batch.num_rows
    except rrd.DamagedError:
        raise _unverified(path, part) from None
    if counted != dict(rows):
        raise _unverified(path, part)


def _rerun(*arguments: str | Path, stdout: BinaryIO | int = subprocess.PIPE) -> str:
    """Run Rerun's command line and return its output; paths are never parsed as options."""
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
    output = (done.stdout or "") + done.stderr
    if done.returncode < 0:  # as by a limit on a file's size, when it prints nothing
        name = signal.Signals(-done.returncode).name
        raise OutputError(
            "rerun {command} was ended by {signal}; is there room for its file?",
            command=f"{arguments[0]} {arguments[1]}",
            signal=name,
        )
    if found := PANIC.search(output):  # as where it gets no memory, or no thread
        raise OutputError(
            "rerun {command} has failed ({reason}); is there enough memory? See: ulimit -a",
            command=f"{arguments[0]} {arguments[1]}",
            reason=found[1],
        )
    if done.returncode != 0:
        raise RuntimeError(f"rerun {arguments[0]} {arguments[1]}: {output.strip()[-300:]}")
    return output

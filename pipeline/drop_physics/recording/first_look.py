"""Quick checks whether files may be recordings, without loading large libraries."""

from __future__ import annotations

from pathlib import Path

from drop_physics.errors import RecordingError
from drop_physics.messages import Message, shell_command

BEGINNING = b"RRF2"
"""First bytes of every Rerun file."""
LAYER = ".analysis.rrd"
"""Suffix of an analysis layer's file name."""


def check_file(path: Path) -> None:
    """Check that a file exists, and begins like a Rerun file.

    Raises
    ------
    RecordingError
        If the check fails; the message suggests what to do.
    """
    if path.is_dir():
        inside = recordings_in(path) or recordings_in(path / "recordings")
        raise RecordingError(
            "{path} is a folder; name a recording in it, such as {file}",
            path=path,
            file=min(inside, default=path / "run.rrd"),
        )
    if not path.exists():
        raise RecordingError(
            "{path} does not exist; make it with drop record or drop simulate", path=path
        )
    if not path.is_file():
        raise RecordingError(
            "{path} is not a recording: it is not a regular file; make one with: drop simulate",
            path=path,
        )
    try:
        with path.open("rb") as file:
            beginning = file.read(len(BEGINNING))
    except OSError as error:
        raise unreadable(path, error) from None
    if beginning != BEGINNING and not (path.name.endswith(".part") and not beginning):
        raise RecordingError(
            "{path} is not a Rerun recording; {make}",
            path=path,
            make=Message(
                "record it first: {command}", command=shell_command("drop", "record", path)
            )
            if path.suffix == ".py"
            else Message("make one with: drop record, or drop simulate"),
        )


def unreadable(path: Path, error: OSError) -> RecordingError:
    """Return the error for a recording that the operating system does not allow to read."""
    return RecordingError(
        "{path} cannot be read: {reason}; see: {command}",
        path=path,
        reason=error.strerror or str(error),
        command=shell_command("ls", "-l", path),
    )


def recordings_in(folder: Path) -> list[Path]:
    """Return the files directly in a folder that are named like recordings, newest first."""
    found = [
        (path.stat().st_mtime_ns, path)
        for path in folder.glob("*.rrd")
        if path.is_file() and not path.name.endswith(LAYER)
    ]
    return [path for _, path in sorted(found, reverse=True)]

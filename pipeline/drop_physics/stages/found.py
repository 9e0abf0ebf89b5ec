"""Finds the recording that a command refers to: a named one, or the newest of a script."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from drop_physics.errors import RecordingError
from drop_physics.messages import Message, shell_command
from drop_physics.recording.first_look import check_file, recordings_in
from drop_physics.stages.program import encodable

FOLDER = Path("recordings")
"""Folder in the working directory for recordings that get a default name."""
SCRIPT_SUFFIX = ".py"
NAMED_WITHOUT = (SCRIPT_SUFFIX, ".npz", ".hdf5", ".h5")
"""Suffixes that are removed to make a recording's name."""
_GOLDEN = re.compile(r"(?<![^\W_])golden(?![^\W_])", re.IGNORECASE)

Origin = dict[str, Any]
"""Properties of the recorded script; empty for a drop."""


def recording_of(given: Path | None, note: Callable[[str], None] = lambda _: None) -> Path:
    """Return the path of the recording that the arguments refer to.

    Parameters
    ----------
    given
        A recording; a script, for its newest recording; None for the newest recording of all.
    note
        A function that is called with a sentence that names the recording, unless `given` does.

    Raises
    ------
    RecordingError
        If there is no recording, or the file is not a recording.
    """
    if given is None:
        found = next((path for path, _ in _recordings()), None)
        if found is None:
            raise RecordingError(
                "there is no recording in {folder}; make one with: drop record SCRIPT.py, or name "
                "the file",
                folder=FOLDER,
            )
        note(Message("{recording} is the newest recording", recording=str(found)))
        return found
    if given.suffix == SCRIPT_SUFFIX:
        return _of_script(given, note)
    check_file(given)
    return given


def _of_script(script: Path, note: Callable[[str], None]) -> Path:
    again = shell_command("drop", "record", script)
    for path, origin in _recordings():
        if not is_of(origin, str(script), is_module=False, where_unknown=True):
            continue
        words = {"recording": str(path), "script": str(script)}
        if text_digest(script) == origin.get("script_sha256"):
            note(Message("{recording} is the newest recording of {script}", **words))
        else:
            note(
                Message(
                    "{recording} is the newest recording of {script}, which has changed since; "
                    "record it again: {again}",
                    **words,
                    again=again,
                )
            )
        return path
    raise RecordingError(
        "there is no recording of {script} in {folder}; make one with: {again}",
        script=script,
        folder=FOLDER,
        again=again,
    )


def is_of(origin: Origin, target: str, *, is_module: bool, where_unknown: bool = False) -> bool:
    """Return whether a recording is of the given script (by resolved path) or module (by name).

    `where_unknown` is returned if the recording does not contain the script's path.
    """
    if origin.get("script") != name_of(target, is_module=is_module):
        return False
    if is_module:
        return True
    place = origin.get("script_path_sha256")
    return where_unknown if place is None else bool(place == path_digest(target))


def name_of(target: str, *, is_module: bool) -> str:
    """Return the name of a script or module as stored in recordings."""
    return encodable(f"-m {target}" if is_module else Path(target).name)


def stem_of(target: str) -> str:
    """Return the file name of a script's recordings, without suffix and number."""
    return Path(target).stem if target.endswith(NAMED_WITHOUT) else Path(target).name


def path_digest(target: str) -> str:
    """Return a digest of a script's resolved path, so that its folders are not disclosed."""
    return hashlib.sha256(bytes(Path(target).resolve())).hexdigest()


def text_digest(script: Path) -> str | None:
    """Return the digest of a script's text; None if it cannot be read."""
    try:
        return hashlib.sha256(script.read_bytes()).hexdigest()
    except OSError:
        return None


def _recordings() -> Iterator[tuple[Path, Origin]]:
    """Yield the recordings in the working directory, newest first, with the script of each.

    Layers, golden recordings and files of other programs are left out. Damaged recordings are
    included: otherwise an older recording would silently be used as the newest.
    """
    for path in recordings_in(FOLDER):
        origin = origin_of(path)
        if origin is None or (_GOLDEN.search(path.stem) and not _named_after(path, origin)):
            continue
        yield path, origin


def origin_of(path: Path) -> Origin | None:
    """Return the script of a recording, {} for a drop; None if drop did not write the file."""
    from drop_physics.recording import schema  # which take half a second to load
    from drop_physics.recording.contents import ForeignError, beginning_of

    try:
        began = beginning_of(path)
    except ForeignError:
        return None
    except RecordingError:
        return {}
    if began is None:
        return None
    name, values = began
    return values if name == schema.ORIGIN_PROPERTY else {}


def _named_after(path: Path, origin: Origin) -> bool:
    """Return whether a recording has the default file name for its script."""
    stem = stem_of(str(origin.get("script", "")).removeprefix("-m "))
    return re.fullmatch(rf"{re.escape(stem)}(-\d+)?", path.stem) is not None

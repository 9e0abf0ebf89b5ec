"""Finds the analysis layer and the trial runs that belong to a recording, by file name."""

from __future__ import annotations

import contextlib
from pathlib import Path

from drop_physics.errors import RecordingError
from drop_physics.recording import schema
from drop_physics.recording.first_look import LAYER
from drop_physics.recording.reader import entities

_TOP = {
    schema.ERROR, schema.ERROR_MM, schema.ENERGY, schema.EVENTS, schema.FINDINGS,
    schema.SEGMENTS, schema.PANELS, "energies", schema.EXPLAINED, schema.IMPULSES, schema.CAUSES,
    schema.PAIRS, schema.CONTACTS.entity,
}  # fmt: skip
"""First parts of a layer's entity paths, including those of earlier versions."""


TRIALS = ".why"
"""Suffix of the folder that contains a recording's trials."""
VERDICTS = "why.json"
"""Name of the file in a recording's folder of trials that contains their results."""


def layer_of(recording: Path) -> Path:
    """Return the path of a recording's layer: `run.analysis.rrd` for `run.rrd`."""
    return recording.with_name(recording.name.removesuffix(".rrd") + LAYER)


def is_layer(path: Path) -> bool:
    """Return whether a file is an analysis layer and nothing else."""
    try:
        return all(entity.split("/")[0] in _TOP for entity in entities(path))
    except RecordingError:
        return False


def trials_of(recording: Path) -> Path:
    """Return the folder for the trial runs of a recording: `run.why` for `run.rrd`."""
    return recording.with_name(recording.name.removesuffix(".rrd") + TRIALS)


def forget_trials(recording: Path) -> None:
    """Delete a recording's trial runs, and their folder unless it contains other files."""
    folder = trials_of(recording)
    if folder.is_dir() and not folder.is_symlink():
        for each in [*folder.glob("*.rrd"), *folder.glob("*.rrd.part"), folder / VERDICTS]:
            each.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            folder.rmdir()

"""Show a recording and a golden one as one, at the first difference."""

from __future__ import annotations

import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from pipeline.recording.contents import is_script
from pipeline.recording.other_layer import write_other_layer
from pipeline.recording.reader import recording_id
from pipeline.recording.script_reader import read_script
from pipeline.stages.check import Check, check
from pipeline.stages.check_script import ScriptCheck, check_script
from pipeline.stages.view import View, view


@contextmanager
def with_golden(recording: Path | str, against: Path | str, *, web: bool = False) -> Iterator[View]:
    """Yield the view of a recording with a golden one in grey; it exists until the block ends.

    Parameters
    ----------
    recording
        The recording to show.
    against
        The golden recording, of the same kind.
    web
        Whether to show them in a browser.

    Raises
    ------
    RecordingError
        If one is missing, damaged or unfinished, or they are of different kinds.
    ViewerError
        If there is no screen.
    """
    path, golden = Path(recording), Path(against)
    of_script = is_script(path)
    checked: ScriptCheck | Check
    not_compared: tuple[str, ...] = ()
    if of_script:
        checked = check_script(path, golden)
        not_compared = tuple(checked.not_compared)
    else:
        checked = check(path, golden)
    step = None if checked.first is None else checked.first.step
    with tempfile.TemporaryDirectory(prefix="drop-") as folder:
        layer = Path(folder, "golden.rrd")
        shown = view([path], web=web, more=[layer])
        labels = _moving(golden) if of_script else None
        write_other_layer(layer, golden, recording_id=recording_id(path), labels=labels)
        yield replace(
            shown,
            golden=golden,
            same=checked.same,
            first_difference=step,
            not_compared=not_compared,
        )


def _moving(golden: Path) -> Collection[str]:
    """Return the labels of the bodies that can move: the others would hide their counterparts."""
    return [body.label for body in read_script(golden).seen.bodies.values() if body.moving]

"""Is the recording of a script the same physics as a golden one? And make one the golden one."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path

import numpy as np

from pipeline.analysis.script.cause import Side
from pipeline.analysis.script.comparison import ScriptComparison, compare_scripts, with_images
from pipeline.analysis.script.difference import Difference
from pipeline.errors import RecordingError
from pipeline.files.whole import replaced
from pipeline.recording.contents import check_of_script, is_script
from pipeline.recording.script_reader import ScriptRecording, read_script
from pipeline.recording.script_scene import frames_of_cameras
from pipeline.shown import Shown
from pipeline.stages.check import (
    Frames,
    check_replaceable,
    check_tolerance,
    pixels,
    there_is_none,
)

__all__ = ["ScriptCheck", "check_script", "is_script"]


@dataclass(frozen=True)
class ScriptCheck(Shown, lines_of="pipeline.console.show_script_check:check_lines"):
    """Whether the recording of a script is the same physics as a golden one, and where not."""

    recording: Path
    """The recording that was checked."""
    golden: Path
    """The recording that is right."""
    tolerance_m: float
    """Difference that was let pass."""
    comparison: ScriptComparison | None
    """None where there was no golden recording yet."""
    frames: Frames | None
    """How the images compare; None where there was no golden recording yet."""
    updated: bool = False
    """Whether the recording has become the golden one."""

    @property
    def first(self) -> Difference | None:
        """Return what differs first: a number, else an image."""
        if self.comparison is not None and self.comparison.first is not None:
            return self.comparison.first
        if self.frames is not None and self.frames.first_step is not None:
            return Difference(self.frames.first_step, None, None, "frame")
        return None

    @property
    def same(self) -> bool:
        """Whether nothing differs by more than is allowed."""
        return self.first is None


def check_script(
    recording: Path | str,
    against: Path | str,
    *,
    tolerance_m: float = 0.0,
    update: bool = False,
) -> ScriptCheck:
    """Compare the recording of a script with a golden one: what went in, samples, then images.

    Parameters
    ----------
    recording
        The recording to check.
    against
        The golden recording.
    tolerance_m
        Difference that is let pass in what moves [m]: of a velocity what moves the body so far in
        one step, of an angle what moves its surface so far. 0 is bit for bit. Above 0 nothing is
        asked of joints, contact points and images but what the motion shows of them, and what the
        script does counts until a sample differs at all: it may answer the difference.
    update
        Whether to make the recording the golden one; what was golden before is replaced.

    Raises
    ------
    RecordingError
        If one of them is missing, damaged, unfinished, or the recording of a drop.
    ScenarioError
        If the tolerance is not a length, or a golden recording is to be written under a name that
        does not end in .rrd.
    OutputError
        If the golden recording is to be written and cannot be, is the recording itself, or has the
        name of a file that is no recording of a script.
    """
    path, golden = Path(recording), Path(against)
    check_tolerance(tolerance_m)
    check_of_script(path, otherwise="check")
    run = _whole(path)
    if not update:
        if not os.path.lexists(golden):
            raise there_is_none(path, golden)
        if not is_script(golden):
            raise RecordingError(
                f"{golden} must be the recording of a script, as {path} is, got that of a drop; "
                "make one with: drop record"
            )
        return _checked(run, _whole(golden), tolerance_m)
    check_replaceable(golden, path, of_script=True)
    try:
        before = _checked(run, _whole(golden), tolerance_m)
    except RecordingError:  # there is none yet, or none that can be read
        before = ScriptCheck(path, golden, tolerance_m, None, None)
    with replaced(golden, force=False, ours=True) as part:
        shutil.copyfile(path, part)
    return replace(before, updated=True)


def _whole(path: Path) -> ScriptRecording:
    recording = read_script(path)
    if recording.partial:
        raise RecordingError(
            f"{path} was never finished, and only whole recordings are compared; record it again "
            "with: drop record"
        )
    return recording


def _checked(run: ScriptRecording, golden: ScriptRecording, tolerance_m: float) -> ScriptCheck:
    sides = [Side(one.origin, one.ended or {}, one.seen) for one in (run, golden)]
    comparison = compare_scripts(*sides, tolerance_m=tolerance_m)
    pictures = _compare_images(run, golden, until=comparison.samples_part_at)
    if tolerance_m:
        pictures = replace(pictures, first_step=None)
    if comparison.same and pictures.first_step is not None:
        comparison = with_images(comparison, *sides, step=pictures.first_step)
    return ScriptCheck(run.path, golden.path, tolerance_m, comparison, pictures)


# -- images ---------------------------------------------------------------------------------------


def _compare_images(run: ScriptRecording, golden: ScriptRecording, *, until: int | None) -> Frames:
    """Compare the images that the cameras took until a sample differs."""
    compared, differing, apart = 0, [], 0
    mine, theirs = (
        {
            camera: [(step, png) for step, _, png in taken]
            for camera, taken in frames_of_cameras(one.path).items()
        }
        for one in (run, golden)
    )
    if not mine and not theirs:
        return Frames(0, 0, None, "neither has images")
    for camera in sorted({*mine, *theirs}):
        for one, other in zip_longest(mine.get(camera, []), theirs.get(camera, [])):
            step = min(taken[0] for taken in (one, other) if taken is not None)
            if until is not None and step >= until:
                apart += 1
                continue
            compared += 1
            if one is None or other is None or not _is(one, other, run, golden):
                differing.append(step)
    why = f"{apart} taken when the bodies are elsewhere" if apart else None
    return Frames(compared, len(differing), min(differing, default=None), why)


def _is(
    one: tuple[int, bytes],
    other: tuple[int, bytes],
    run: ScriptRecording,
    golden: ScriptRecording,
) -> bool:
    """Whether two images are of the same step and the same to the pixel."""
    return one == other or (
        one[0] == other[0]
        and np.array_equal(pixels(one[1], run.path), pixels(other[1], golden.path))
    )

"""Check whether a script's recording is the same physics as a golden one, or make it golden."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from pipeline.analysis.script.cause import Side
from pipeline.analysis.script.comparison import ScriptComparison, compare_scripts, with_images
from pipeline.analysis.script.difference import Difference
from pipeline.errors import RecordingError
from pipeline.files.whole import replaced
from pipeline.messages import Message
from pipeline.recording.contents import check_of_script, is_script
from pipeline.recording.script_reader import ScriptRecording, read_script
from pipeline.recording.script_scene import frames_of_cameras
from pipeline.shown import Shown
from pipeline.stages.check import (
    Frames,
    check_replaceable,
    check_tolerance,
    no_golden,
    pixels,
    unfinished,
)

__all__ = ["ScriptCheck", "check_script", "is_script"]


@dataclass(frozen=True)
class ScriptCheck(Shown, lines_of="pipeline.console.show_script_check:check_lines"):
    """Whether the recording of a script is the same physics as a golden one, and where not."""

    recording: Path
    """The recording that was checked."""
    golden: Path
    """The recording it was compared with."""
    tolerance_m: float
    """Largest difference that passes."""
    comparison: ScriptComparison | None
    """None where there was no golden recording yet."""
    frames: Frames | None
    """How the images compare; None where there was no golden recording yet."""
    updated: bool = False
    """Whether the recording has been made the golden one."""

    @property
    def first(self) -> Difference | None:
        """Return what differs first: a number, else an image."""
        if self.comparison is not None and self.comparison.first is not None:
            return self.comparison.first
        if self.frames is not None and self.frames.first_step is not None:
            return Difference(self.frames.first_step, None, None, "frame")
        return None

    @property
    def not_compared(self) -> list[str]:
        """Return the bodies whose motion is not recorded."""
        return [] if self.comparison is None else self.comparison.not_compared

    @property
    def same(self) -> bool:
        """Whether nothing differs by more than is allowed, and nothing was left out."""
        return self.first is None and not self.not_compared


def check_script(
    recording: Path | str,
    against: Path | str,
    *,
    tolerance_m: float = 0.0,
    update: bool = False,
) -> ScriptCheck:
    """Compare the recording of a script with a golden one: inputs, samples, then images.

    Parameters
    ----------
    recording
        The recording to check.
    against
        The golden recording.
    tolerance_m
        Largest difference in motion that passes [m]: of a velocity the distance in one step, of an
        angle the way of the body's surface. 0 is bit for bit. Above 0, joints, contact points and
        images count only through the motion, and the script's calls only until a sample differs at
        all: they may be a response to the difference.
    update
        Whether to make the recording the golden one, in place of the previous one.

    Raises
    ------
    RecordingError
        If one of them is missing, damaged, unfinished, or the recording of a drop.
    ScenarioError
        If the tolerance is not a length, or with `update` if the golden recording's name does not
        end in .rrd.
    OutputError
        With `update`, if the golden recording cannot be written, is the recording itself, or is a
        file that is not a recording of a script.
    """
    path, golden = Path(recording), Path(against)
    check_tolerance(tolerance_m)
    check_of_script(path, otherwise="check")
    run = _whole(path)
    if not update:
        if not os.path.lexists(golden):
            raise no_golden(path, golden)
        if not is_script(golden):
            raise RecordingError(
                "{golden} must be the recording of a script, as {path} is; make one with: drop "
                "record",
                golden=golden,
                path=path,
            )
        return _checked(run, _whole(golden), tolerance_m)
    check_replaceable(golden, path, of_script=True)
    try:
        before = _checked(run, _whole(golden), tolerance_m)
    except RecordingError:  # there is none yet, or it cannot be read
        before = ScriptCheck(path, golden, tolerance_m, None, None)
    with replaced(golden, force=False, ours=True) as part:
        shutil.copyfile(path, part)
    return replace(before, updated=True)


def _whole(path: Path) -> ScriptRecording:
    recording = read_script(path)
    if recording.partial:
        raise unfinished(path, "record")
    return recording


def _checked(run: ScriptRecording, golden: ScriptRecording, tolerance_m: float) -> ScriptCheck:
    sides = [Side(each.origin, each.ended or {}, each.seen) for each in (run, golden)]
    comparison = compare_scripts(*sides, tolerance_m=tolerance_m)
    pictures, both = _compare_images(run, golden, until=comparison.samples_part_at)
    if tolerance_m:
        pictures = replace(pictures, first_step=None)
    if comparison.first is None and pictures.first_step is not None:
        comparison = with_images(comparison, *sides, step=pictures.first_step, both=both)
    return ScriptCheck(run.path, golden.path, tolerance_m, comparison, pictures)


# -- images ---------------------------------------------------------------------------------------


def _compare_images(
    run: ScriptRecording, golden: ScriptRecording, *, until: int | None
) -> tuple[Frames, bool]:
    """Compare the images that the cameras took until a sample differs.

    Also return whether both took the first that differs.
    """
    compared, differing, apart = 0, [], 0
    mine, theirs = _images(run.path), _images(golden.path)
    if not mine and not theirs:
        return Frames(0, 0, None, Message("neither has images")), True
    for key in sorted({*mine, *theirs}):
        step, image, other = key[0], mine.get(key), theirs.get(key)
        if until is not None and step >= until:
            apart += 1
            continue
        compared += 1
        if image is None or other is None:
            differing.append((step, False))
        elif image != other and not np.array_equal(
            pixels(image, run.path), pixels(other, golden.path)
        ):
            differing.append((step, True))
    why = Message("{n} taken when the bodies are elsewhere", n=apart) if apart else None
    first, both = min(differing, default=(None, True))
    return Frames(compared, len(differing), first, why), both


def _images(path: Path) -> dict[tuple[int, int, int], bytes]:
    """Return the images of a recording by step, camera and how many it took there before."""
    images: dict[tuple[int, int, int], bytes] = {}
    for camera, taken in frames_of_cameras(path).items():
        for step, same_step in groupby(taken, key=lambda image: image[0]):
            images |= {(step, camera, n): png for n, (_, _, png) in enumerate(same_step)}
    return images

"""Check whether a recording is the same physics as a golden one, or make it the golden one."""

from __future__ import annotations

import math
import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.analysis.drop.comparison import Comparison, Place, Side, compare
from pipeline.analysis.general.samples import base_of
from pipeline.errors import OutputError, RecordingError, ScenarioError, check_suffix
from pipeline.fields import all_of
from pipeline.figures.animation import decoded
from pipeline.files.outputs import check_apart, check_target
from pipeline.files.whole import replaced
from pipeline.messages import Message, joined, shell_command
from pipeline.recording import sealing
from pipeline.recording.checks import damaged
from pipeline.recording.contents import check_of_drop
from pipeline.recording.reader import Recording, frames, is_recording, read
from pipeline.scenario import Camera
from pipeline.shown import Shown

POSE = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]


@dataclass(frozen=True)
class Frames:
    """How the pictures of two recordings compare."""

    compared: int
    """How many pairs of pictures of the same pose."""
    differing: int
    """How many of these differ."""
    first_step: int | None
    """Step of the first that differ; None where none do."""
    why: str | None
    """Why no more were compared; None where all were."""


@dataclass(frozen=True)
class Check(Shown, lines_of="pipeline.console.show_check:check_lines"):
    """Whether a recording is the same physics as a golden one, and where it is not."""

    recording: Path
    """The recording that was checked."""
    golden: Path
    """The recording it was compared with."""
    tolerance_m: float
    """Largest difference that passes."""
    comparison: Comparison | None
    """None where there was no golden recording yet."""
    frames: Frames | None
    """How the pictures compare; None where the samples cannot be compared."""
    updated: bool = False
    """Whether the recording has been made the golden one."""

    @property
    def first(self) -> Place | None:
        """Return what differs first: a number, else a frame."""
        if self.comparison is not None and self.comparison.first is not None:
            return self.comparison.first
        if self.frames is not None and self.frames.first_step is not None:
            return Place(self.frames.first_step, "frame")
        return None

    @property
    def same(self) -> bool:
        """Whether nothing differs by more than is allowed."""
        return self.first is None and (self.comparison is None or self.comparison.same)


def check(
    recording: Path | str,
    against: Path | str,
    *,
    tolerance_m: float = 0.0,
    update: bool = False,
) -> Check:
    """Compare a recording with a golden one: settings, then state and contacts, then frames.

    Parameters
    ----------
    recording
        The recording to check.
    against
        The golden recording.
    tolerance_m
        Largest difference that passes [m]; 0 is bit for bit in the air and 1e-9 m in contact.
    update
        Whether to make the recording the golden one, in place of the previous one.

    Raises
    ------
    RecordingError
        If one of them is missing, damaged or unfinished.
    ScenarioError
        If the tolerance is not a length, or with `update` if the golden recording's name does not
        end in .rrd.
    OutputError
        With `update`, if the golden recording cannot be written, is the recording itself, or is a
        file that is not a recording.
    """
    path, golden = Path(recording), Path(against)
    check_tolerance(tolerance_m)
    check_of_drop(path, otherwise="check_script")
    run = _whole(path)
    if not update:
        if not os.path.lexists(golden):
            raise no_golden(path, golden)
        return _checked(run, _whole(golden), tolerance_m)
    check_replaceable(golden, path)
    try:
        before = _checked(run, _whole(golden), tolerance_m)
    except RecordingError:  # there is none yet, or it cannot be read
        before = Check(path, golden, tolerance_m, None, None)
    _make_golden(run, golden)
    return replace(before, updated=True)


def check_tolerance(tolerance_m: float) -> None:
    """Raise a ScenarioError if a tolerance is not a length."""
    if not (math.isfinite(tolerance_m) and tolerance_m >= 0):
        raise ScenarioError(
            "--tolerance must be finite and at least 0, got {tolerance!r}", tolerance=tolerance_m
        )


def check_replaceable(golden: Path, recording: Path, *, of_script: bool = False) -> None:
    """Check that a recording can be made the golden one.

    Raises
    ------
    ScenarioError
        If the golden recording's name does not end in .rrd.
    OutputError
        If it cannot be written, is the recording itself, or is not a recording of this kind.
    """
    check_target(golden, force=True)
    check_apart([golden], inputs=[recording])
    check_suffix("--against", golden, (".rrd",))
    if os.path.lexists(golden) and not is_recording(golden, of_script=of_script):
        if of_script:
            raise OutputError(
                "{path} is not a recording of a script, or is damaged, and is not replaced; remove "
                "it, or give --against another name",
                path=golden,
            )
        raise OutputError(
            "{path} is not a recording made by drop, or is damaged, and is not replaced; remove "
            "it, or give --against another name",
            path=golden,
        )


def no_golden(recording: Path, golden: Path) -> RecordingError:
    """Return the error for a missing golden recording."""
    update = shell_command("drop", "check", recording, "--against", golden, "--update")
    return RecordingError(
        "there is no golden recording {golden}; to make {recording} the golden one: {command}",
        golden=golden, recording=recording, command=update,
    )  # fmt: skip


def unfinished(path: Path, command: str) -> RecordingError:
    """Return the error for a recording that is not complete."""
    return RecordingError(
        "{path} was never finished, and only complete recordings are compared; record it again "
        "with: drop {command}",
        path=path,
        command=command,
    )


def _whole(path: Path) -> Recording:
    recording = read(path)
    if recording.partial:
        raise unfinished(path, "simulate")
    return recording


def _checked(run: Recording, golden: Recording, tolerance_m: float) -> Check:
    sides = [Side(each.scenario, each.engine, each.states, each.contacts) for each in (run, golden)]
    comparison = compare(*sides, tolerance_m=tolerance_m)
    comparable = comparison.largest_difference_m is not None
    pictures = _compare_frames(run, golden) if comparable else None
    return Check(run.path, golden.path, tolerance_m, comparison, pictures)


def _make_golden(run: Recording, golden: Path) -> None:
    """Write a recording under the golden name, packed; check that it reads back the same."""
    with replaced(golden, force=False, ours=True) as part:
        sealing.pack(run.path, part)
        packed = _whole(part)
        if not (packed.states.equals(run.states) and packed.contacts.equals(run.contacts)):
            raise RecordingError(
                "{golden} was not written: packing {path} changed its state",
                golden=golden, path=run.path,
            )  # fmt: skip
        if [step for step, _ in frames(part)] != [step for step, _ in frames(run.path)]:
            raise RecordingError(
                "{golden} was not written: packing {path} lost frames",
                golden=golden, path=run.path,
            )  # fmt: skip


# -- frames ---------------------------------------------------------------------------------------


def _compare_frames(run: Recording, golden: Recording) -> Frames:
    """Compare the pictures that both have of the same pose; pictures of other poses may differ."""
    if run.camera is None and golden.camera is None:
        why = Message("neither {one} nor {other} has frames", one=run.path, other=golden.path)
        return Frames(0, 0, None, why)
    if run.camera is None or golden.camera is None:
        without = run.path if run.camera is None else golden.path
        return Frames(0, 0, None, Message("{path} has no frames", path=without))
    mine, theirs = dict(frames(run.path)), dict(frames(golden.path))  # raises an error if damaged
    if run.camera != golden.camera:
        differences = _camera_differences(run.camera, golden.camera)
        why = Message("the cameras differ: {differences}", differences=differences)
        return Frames(0, 0, None, why)
    if run.engine.machine != golden.engine.machine:
        return Frames(0, 0, None, Message("they were drawn on different kinds of machine"))
    poses, others = base_of(run.states), base_of(golden.states)
    same_pose = poses.select(
        pl.all_horizontal(pl.col(name) == others[name] for name in POSE)
    ).to_series()
    steps = [step for step in sorted(mine.keys() & theirs.keys()) if same_pose[step]]
    differing = [
        step
        for step in steps
        if mine[step] != theirs[step]
        and not np.array_equal(pixels(mine[step], run.path), pixels(theirs[step], golden.path))
    ]
    apart, first_step = len(mine) - len(steps), differing[0] if differing else None
    elsewhere = Message("in {n} of {frames} the body is elsewhere", n=apart, frames=len(mine))
    return Frames(len(steps), len(differing), first_step, elsewhere if apart else None)


def _camera_differences(run: Camera, golden: Camera) -> Message:
    mine, theirs, options = asdict(run), asdict(golden), Camera.options()
    differences = []
    for name in mine:
        if mine[name] != theirs[name]:
            option = options.get(name)
            written = str if option is None else option.written
            values = all_of(map(written, (mine[name], theirs[name])))
            label = name if option is None else option.name
            differences.append(Message("{label} {values}", label=label, values=values))
    return joined(", ", differences)


def pixels(png: bytes, path: Path) -> NDArray[np.uint8]:
    """Return a recorded picture's pixels, or raise a RecordingError."""
    try:
        return np.asarray(next(decoded([png])))
    except ValueError as error:
        raise damaged(path, error.args[0]) from None

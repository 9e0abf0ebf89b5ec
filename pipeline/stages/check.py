"""Is this recording the same physics as a golden one? And make a recording the golden one."""

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
from pipeline.figures.animation import decoded
from pipeline.files.outputs import check_apart, check_target
from pipeline.files.whole import replaced
from pipeline.messages import shell_command
from pipeline.recording import sealing
from pipeline.recording.checks import again
from pipeline.recording.contents import check_of_drop
from pipeline.recording.reader import Recording, frames, is_recording, read
from pipeline.scenario import Camera
from pipeline.shown import Shown

POSE = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]


@dataclass(frozen=True)
class Frames:
    """How the pictures of two recordings compare."""

    compared: int
    """How many pictures of one pose both have."""
    differing: int
    """How many of these differ."""
    first_step: int | None
    """The first that does; None where none does."""
    why: str | None
    """Why no more were compared; None where all were."""


@dataclass(frozen=True)
class Check(Shown, lines_of="pipeline.console.show_check:check_lines"):
    """Whether a recording is the same physics as a golden one, and where it is not."""

    recording: Path
    """The recording that was checked."""
    golden: Path
    """The recording that is right."""
    tolerance_m: float
    """Difference that was let pass."""
    comparison: Comparison | None
    """None where there was no golden recording yet."""
    frames: Frames | None
    """How the pictures compare; None where the samples cannot be compared."""
    updated: bool = False
    """Whether the recording has become the golden one."""

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
        Difference that is let pass [m]; 0 is bit for bit in the air and 1e-9 m in contact.
    update
        Whether to make the recording the golden one; what was golden before is replaced.

    Raises
    ------
    RecordingError
        If one of them is missing, damaged or unfinished.
    ScenarioError
        If the tolerance is not a length, or a golden recording is to be written under a name that
        does not end in .rrd.
    OutputError
        If the golden recording is to be written and cannot be, is the recording itself, or has the
        name of a file that is no recording.
    """
    path, golden = Path(recording), Path(against)
    check_tolerance(tolerance_m)
    check_of_drop(path, otherwise="check_script")
    run = _whole(path)
    if not update:
        if not os.path.lexists(golden):
            raise there_is_none(path, golden)
        return _checked(run, _whole(golden), tolerance_m)
    check_replaceable(golden, path)
    try:
        before = _checked(run, _whole(golden), tolerance_m)
    except RecordingError:  # there is none yet, or none that can be read
        before = Check(path, golden, tolerance_m, None, None)
    _make_golden(run, golden)
    return replace(before, updated=True)


def check_tolerance(tolerance_m: float) -> None:
    """Raise a ScenarioError if a tolerance is not a length."""
    if not (math.isfinite(tolerance_m) and tolerance_m >= 0):
        raise ScenarioError(f"--tolerance must be finite and at least 0, got {tolerance_m!r}")


def check_replaceable(golden: Path, recording: Path, *, of_script: bool = False) -> None:
    """Make sure that a recording can become the golden one.

    Raises
    ------
    ScenarioError
        If the golden recording's name does not end in .rrd.
    OutputError
        If it cannot be written, is the recording itself, or is no recording of this kind.
    """
    check_target(golden, force=True)
    check_apart([golden], inputs=[recording])
    check_suffix("--against", golden, (".rrd",))
    if os.path.lexists(golden) and not is_recording(golden, of_script=of_script):
        kind = "the recording of a script" if of_script else "a recording that drop made"
        raise OutputError(
            f"{golden} is not {kind}, or is damaged, and is left as it is; remove it, or give "
            "--against another name"
        )


def there_is_none(recording: Path, golden: Path) -> RecordingError:
    """Return the error for a golden recording that is not there."""
    again = shell_command("drop", "check", recording, "--against", golden, "--update")
    return RecordingError(
        f"there is no golden recording {golden}; to make {recording} the golden one: {again}"
    )


def _whole(path: Path) -> Recording:
    recording = read(path)
    if recording.partial:
        raise RecordingError(
            f"{path} was never finished, and only whole recordings are compared; record it again "
            "with: drop simulate"
        )
    return recording


def _checked(run: Recording, golden: Recording, tolerance_m: float) -> Check:
    sides = [Side(one.scenario, one.engine, one.states, one.contacts) for one in (run, golden)]
    comparison = compare(*sides, tolerance_m=tolerance_m)
    comparable = comparison.largest_difference_m is not None
    pictures = _compare_frames(run, golden) if comparable else None
    return Check(run.path, golden.path, tolerance_m, comparison, pictures)


def _make_golden(run: Recording, golden: Path) -> None:
    """Write a recording under the golden name, packed, if it reads back the same."""
    with replaced(golden, force=False, ours=True) as part:
        sealing.pack(run.path, part)
        packed = _whole(part)
        if not (packed.states.equals(run.states) and packed.contacts.equals(run.contacts)):
            raise RecordingError(f"{golden} was not written: packing {run.path} changed its state")
        if [step for step, _ in frames(part)] != [step for step, _ in frames(run.path)]:
            raise RecordingError(f"{golden} was not written: packing {run.path} lost frames")


# -- frames ---------------------------------------------------------------------------------------


def _compare_frames(run: Recording, golden: Recording) -> Frames:
    """Compare the pictures that both have of the same pose; pictures of other poses may differ."""
    if run.camera is None or golden.camera is None:
        without = [str(one.path) for one in (run, golden) if one.camera is None]
        why = f"neither {' nor '.join(without)} has" if len(without) > 1 else f"{without[0]} has no"
        return Frames(0, 0, None, f"{why} frames")
    mine, theirs = dict(frames(run.path)), dict(frames(golden.path))  # or an error
    if run.camera != golden.camera:
        return Frames(0, 0, None, f"the cameras differ: {_camera_differences(run, golden)}")
    if run.engine.machine != golden.engine.machine:
        return Frames(0, 0, None, "they were drawn on different kinds of machine")
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
    apart = len(mine) - len(steps)
    return Frames(
        compared=len(steps),
        differing=len(differing),
        first_step=differing[0] if differing else None,
        why=f"in {apart} of {len(mine)} the body is elsewhere" if apart else None,
    )


def _camera_differences(run: Recording, golden: Recording) -> str:
    assert run.camera is not None
    assert golden.camera is not None
    mine, theirs, options = asdict(run.camera), asdict(golden.camera), Camera.options()
    said = []
    for name in mine:
        if mine[name] != theirs[name]:
            option = options.get(name)
            one, other = (
                str(value) if option is None else option.written(value)
                for value in (mine[name], theirs[name])
            )
            said.append(f"{name if option is None else option.name} {one} and {other}")
    return ", ".join(said)


def pixels(png: bytes, path: Path) -> NDArray[np.uint8]:
    """Return what a picture of a recording shows, or raise a RecordingError."""
    try:
        return np.asarray(next(decoded([png])))
    except ValueError as error:
        raise RecordingError(f"{path} is damaged: {error}; {again(path)}") from None

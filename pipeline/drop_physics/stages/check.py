"""The command `check`: compares a recording with a golden one, or replaces the golden one."""

from __future__ import annotations

import math
import os
import shutil
from collections import Counter
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drop_physics.compare.comparison import Comparison, compare
from drop_physics.compare.difference import Difference, DropInputs, Side
from drop_physics.errors import OutputError, RecordingError, check_suffix
from drop_physics.fields import outside
from drop_physics.files.outputs import check_apart, check_target, output_errors
from drop_physics.files.whole import replaced, written_whole
from drop_physics.messages import Message, shell_command
from drop_physics.printable import Printable
from drop_physics.recording import sealing
from drop_physics.recording.damage import damaged
from drop_physics.recording.frames import frames, frames_of_cameras
from drop_physics.recording.reader import Recording, is_recording, read
from drop_physics.trace.acts import PICTURE

if TYPE_CHECKING:
    from drop_physics.stages.diff import Diff
from drop_physics.stages import verbs
from drop_physics.stages.verbs.taken import takes_those_of

Image = tuple[int, int, int]
"""An image's step, camera, and its index among the camera's images in that step."""
WRITTEN = "Written by drop with this golden recording: what it holds."
"""A line that marks drop's own descriptions of golden recordings."""
NEITHER = Message("neither has images")
DIGEST = b"digest "
"""First bytes of an image's placeholder, if only a digest of the image is recorded."""


@dataclass(frozen=True)
class FrameComparison:
    """How many images of two recordings differ."""

    compared: int
    """Number of images compared: those taken before any state differs."""
    differing: int
    """Number of compared images that differ, or that only one recording has."""
    first_step: int | None
    """Step of the first image that differs; None if none differs, or if images are not compared."""
    why: str | None
    """Reason why no further images were compared; None if all images were compared."""


@dataclass(frozen=True)
class Check(Printable, reported_by="drop_physics.report.check"):
    """Result of comparing a recording with a golden one: the verdict, and the differences."""

    recording: Path
    """The checked recording."""
    golden: Path
    """The golden recording."""
    tolerance_m: float
    """Largest difference that is accepted."""
    comparison: Comparison | None
    """Differences in numbers; None if there was no golden recording before."""
    frames: FrameComparison | None
    """Comparison of the images; None if there was no golden recording before."""
    engines: str | None = None
    """The place and the cause of the difference, if two drops differ only in the engine."""
    updated: bool = False
    """Whether the checked recording has become the golden one."""
    why: Printable | None = None
    """A `Diff` that explains the difference; None if the cause is unknown, or for a drop."""
    lacks: tuple[str, ...] = ()
    """Contents that were not compared, since one of the recordings lacks them because of an older
    schema."""

    @property
    def first(self) -> Difference | None:
        """The first difference: of a number, or of an image if all numbers agree."""
        if self.comparison is not None and self.comparison.first is not None:
            return self.comparison.first
        if self.frames is not None and self.frames.first_step is not None:
            return Difference(self.frames.first_step, None, None, "frame")
        return None

    @property
    def not_compared(self) -> list[str]:
        """Bodies whose motion is not recorded, and so not compared."""
        return [] if self.comparison is None else self.comparison.not_compared

    @property
    def same(self) -> bool:
        """True if no difference exceeds the tolerance and everything was compared."""
        return self.first is None and (self.comparison is None or self.comparison.same)


@takes_those_of(verbs.CheckArguments)
def check(asked: verbs.CheckArguments) -> Check:
    """Compare a recording with a golden one: inputs, then samples, then images.

    Raises
    ------
    RecordingError
        If a recording is missing, damaged or unfinished, or one is of a drop and the other of a
        script.
    ScenarioError
        If the tolerance is not a length; with `update`, if the golden recording's name does not end
        in .rrd.
    OutputError
        With `update`, if the golden recording cannot be written, is the same file as the recording,
        or is a file of another kind.
    """
    path, golden = Path(asked.recording), Path(asked.against)
    if not (math.isfinite(asked.tolerance_m) and asked.tolerance_m >= 0):
        domain = Message("finite and at least {low:g}", low=0)
        raise outside("--tolerance", domain, asked.tolerance_m)
    run = _whole(path)
    if not asked.update:
        if not os.path.lexists(golden):
            raise _no_golden(path, golden)
        return _checked(run, _whole(golden), asked.tolerance_m)
    _check_replaceable(golden, run)
    try:
        before = _checked(run, _whole(golden), asked.tolerance_m)
    except RecordingError:  # there is none yet, or it cannot be read
        before = Check(path, golden, asked.tolerance_m, None, None)
    _make_golden(run, golden)
    _describe(golden)
    return replace(before, updated=True)


def _whole(path: Path) -> Recording:
    recording = read(path)
    if recording.partial:
        raise RecordingError(
            "{path} was never finished, and only complete recordings are compared; record it again "
            "with: drop {command}",
            path=path,
            command="simulate" if recording.drop else "record",
        )
    return recording


def _no_golden(recording: Path, golden: Path) -> RecordingError:
    update = shell_command("drop", "check", recording, "--against", golden, "--update")
    return RecordingError(
        "there is no golden recording {golden}; to make {recording} the golden one: {command}",
        golden=golden,
        recording=recording,
        command=update,
    )


def _checked(run: Recording, golden: Recording, tolerance_m: float) -> Check:
    both = {"golden": golden.path, "path": run.path}
    if run.drop is None and golden.drop is not None:
        raise RecordingError(
            "{golden} must be the recording of a script, as {path} is; make one with: drop record",
            **both,
        )
    if run.drop is not None and golden.drop is None:
        raise RecordingError(
            "{golden} must be the recording of a drop, as {path} is; make one with: drop simulate",
            **both,
        )
    comparison = compare(_side(run), _side(golden), tolerance_m=tolerance_m)
    pictures = _compare_frames(run, golden, until=comparison.part_at)
    if tolerance_m:
        pictures = replace(pictures, first_step=None)
    engines = None
    if [difference.column for difference in comparison.differences] == ["engine"]:
        from drop_physics.drop.case import DropCase
        from drop_physics.drop.engines_compared import apart, flight_of

        flights = [
            flight_of(DropCase(each.scenario, each.engine, each.seen)) for each in (run, golden)
        ]
        first = comparison.first
        engines = apart(*flights, parts_at=None if first is None else first.step)
    return Check(
        run.path,
        golden.path,
        tolerance_m,
        comparison,
        pictures,
        engines,
        why=_why(run, golden, comparison, tolerance_m),
        lacks=tuple(each.lacks for each in (run, golden) if each.lacks is not None),
    )


def _why(
    run: Recording, golden: Recording, comparison: Comparison, tolerance_m: float
) -> Diff | None:
    """Return why two runs of scripts differ, if that can be found."""
    if run.drop is not None or (comparison.first is None and comparison.same):
        return None
    from drop_physics.stages.diff import why_apart

    found = why_apart(golden, run, ("golden", run.path.name), tolerance_m)
    return None if found is None or found.answer.cls in (None, "none") else found


def _side(recording: Recording) -> Side:
    drop = recording.drop
    return Side(
        recording.seen,
        recording.origin,
        recording.ended or {},
        None if drop is None else DropInputs(drop.scenario, drop.engine),
    )


# -- update ---------------------------------------------------------------------------------------


def _check_replaceable(golden: Path, run: Recording) -> None:
    """Check that a recording may replace the golden one."""
    check_target(golden, force=True)
    check_apart([golden], inputs=[run.path])
    check_suffix("--against", golden, (".rrd",))
    if os.path.lexists(golden) and not is_recording(golden, of_script=run.drop is None):
        raise OutputError(
            "{path} is not a recording made by drop of the kind of {recording}, or is damaged, and "
            "is not replaced; remove it, or give --against another name",
            path=golden,
            recording=run.path,
        )


def _make_golden(run: Recording, golden: Path) -> None:
    """Save a recording as the golden one; a drop's is compacted, then read back as a check."""
    with replaced(golden, force=False, ours=True) as part:
        if run.drop is None:
            shutil.copyfile(run.path, part)
            return
        sealing.pack(run.path, part)
        packed = _whole(part)
        whole = packed.states.equals(run.states) and packed.contacts.equals(run.contacts)
        if not whole or [s for s, _ in frames(packed)] != [s for s, _ in frames(run)]:
            raise RecordingError(
                "{golden} was not written: packing {path} changed it; run it again",
                golden=golden,
                path=run.path,
            )


def _describe(golden: Path) -> None:
    """Write a short Markdown summary next to a golden recording, so that reviews show changes.

    A file of the same name that drop did not write is not replaced.
    """
    from drop_physics.stages.analyze import analysis_of  # loads every rule
    from drop_physics.stages.info import engine_of

    beside, held = golden.with_suffix(".md"), read(golden)
    made_with = f" Made with {engine_of(held)}." if held.drop is None else ""
    title = f"# {golden.name}\n\n{WRITTEN}{made_with}\n"
    with output_errors(beside):
        if beside.exists() and WRITTEN not in beside.read_text(encoding="utf-8", errors="replace"):
            return
    text = analysis_of(held).markdown(at_the_end=True)
    with written_whole(beside, force=True) as file:
        file.write(f"{title}\n{text.strip()}\n".encode())


# -- pictures -------------------------------------------------------------------------------------


def _compare_frames(run: Recording, golden: Recording, *, until: int | None) -> FrameComparison:
    """Compare images taken before any state differs; later images show other poses."""
    mine, theirs = _images(run), _images(golden)  # raises an error if damaged
    if (why := _incomparable(run, golden)) is not None:
        return FrameComparison(0, 0, None, why)
    if not mine and not theirs:
        return FrameComparison(0, 0, None, NEITHER)
    keys = sorted(mine.keys() | theirs.keys())
    compared = [key for key in keys if until is None or key[0] < until]
    differing = [
        key[0] for key in compared if not _same_pixels(mine.get(key), theirs.get(key), run, golden)
    ]
    apart = len(keys) - len(compared)
    why = Message("{n} taken when the bodies are elsewhere", n=apart) if apart else None
    return FrameComparison(len(compared), len(differing), min(differing, default=None), why)


def _incomparable(run: Recording, golden: Recording) -> Message | None:
    """Return why the images of two drops cannot be compared; None if they can."""
    if run.drop is None or golden.drop is None:
        return None
    without = [each.path for each in (run, golden) if each.camera is None]
    if without:
        return NEITHER if len(without) > 1 else Message("{path} has no frames", path=without[0])
    if run.camera != golden.camera:
        return Message("the cameras differ")
    if run.engine.machine != golden.engine.machine:
        return Message("they were drawn on different kinds of machine")
    return None


def _images(recording: Recording) -> dict[Image, bytes]:
    """Return the images of a recording as PNG."""
    if recording.drop is not None and recording.camera is None:
        return {}
    if recording.drop is not None:
        return {(step, 0, 0): png for step, png in frames(recording)}
    images = _digests(recording)
    for camera, taken in frames_of_cameras(recording).items():
        for step, same_step in groupby(taken, key=lambda image: image[0]):
            images |= {(step, camera, n): png for n, (_, _, png) in enumerate(same_step)}
    return images


def _digests(recording: Recording) -> dict[Image, bytes]:
    """Return digests of the images that a script's engine drew; the images are not recorded.

    The id of the simulation is used in place of a camera's.
    """
    images: dict[Image, bytes] = {}
    before: Counter[tuple[int, int]] = Counter()
    for call in recording.seen.calls.named(PICTURE):
        shown = call.at.step, call.client
        images[*shown, before[shown]] = DIGEST + str(call.numbers).encode()
        before[shown] += 1
    return images


def _same_pixels(
    mine: bytes | None, theirs: bytes | None, run: Recording, golden: Recording
) -> bool:
    if mine is None or theirs is None:
        return False
    if mine == theirs or mine.startswith(DIGEST) or theirs.startswith(DIGEST):
        return mine == theirs
    return np.array_equal(_pixels(mine, run.path), _pixels(theirs, golden.path))


def _pixels(png: bytes, path: Path) -> NDArray[np.uint8]:
    """Decode a recorded image to pixels, or raise a RecordingError."""
    from drop_physics.figures.animation import decoded  # loads Pillow

    try:
        return np.asarray(next(decoded([png])))
    except ValueError as error:
        raise damaged(path, error.args[0]) from None

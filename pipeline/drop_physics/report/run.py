"""The report of files made from a drop or script: recording, video, plot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from drop_physics.fields import counted
from drop_physics.messages import Message, joined, shell_command
from drop_physics.report.blocks import Facts, File, Report, Section
from drop_physics.report.words import PLOT, RECORDING
from drop_physics.stages.render import Rendering
from drop_physics.stages.run import Run

if TYPE_CHECKING:
    from drop_physics.stages.simulate import Simulation

COLUMN = 17
"""Width of the column of titles."""


def report_of(made: Simulation | Rendering | Run, *, recording: Path | None = None) -> Report:
    """Report the files made from a recording; for a run, below the report of its analysis."""
    notes = []
    if recording is not None and recording.suffix == ".part":
        notes.append(
            Message(
                "{recording} was never finished: this shows what it holds, unverified",
                recording=str(recording),
            )
        )
    if isinstance(made, Rendering):
        seen = [] if recording is None else [shell_command("drop", "view", recording)]
        return Report(sections=[_made(*_rendering(made))], notes=notes, next=seen)
    if not isinstance(made, Run):
        verbs = [shell_command("drop", verb, made.recording) for verb in ("analyze", "view")]
        return Report(sections=[_made(_simulation(made))], notes=notes, next=verbs)
    story: Report = made.analysis.report()
    files = _made(_simulation(made.simulation), *_rendering(made.rendering))
    return replace(story, sections=[*story.sections, files], notes=(), code=0)


def _made(*files: File) -> Section:
    return Section([Facts(files, COLUMN)])


def _simulation(simulation: Simulation) -> File:
    facts = Message(
        "{samples}, {frames}, {kilobytes:,.0f} kB, {wall_s:.1f} s",
        samples=counted(simulation.samples, "sample"),
        frames=counted(simulation.frames, "frame"),
        kilobytes=simulation.bytes / 1e3,
        wall_s=simulation.wall_s,
    )
    return File(RECORDING, simulation.recording, facts)


def _rendering(rendering: Rendering) -> Iterator[File]:
    """Yield the rendered files, and the playback speed of the video."""
    if rendering.gif is not None:
        frames = counted(rendering.frames, "frame")
        facts = [frames, f"{rendering.frames / rendering.fps:.2f} s"]
        if rendering.speed is not None:
            facts.append(_speed(rendering.speed))
        yield File(rendering.gif.suffix[1:], rendering.gif, joined(", ", facts))
    if rendering.plot is not None:
        yield File(PLOT, rendering.plot)


def _speed(speed: float) -> Message:
    """Describe a playback speed: real time, or a fraction or multiple of it."""
    if abs(speed - 1) < 5e-4:
        return Message("in real time")
    if speed < 1:
        return Message("{times:.4g} times slower", times=1 / speed)
    return Message("{times:.4g} times faster", times=speed)

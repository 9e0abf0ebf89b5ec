"""The three stages in a row, with the recording handed from one to the next."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.figures.playback import EVERY_FRAME, Animation
from pipeline.recording.outputs import make_folder, part_of, reserved, sealed_of
from pipeline.scenario import STANDARD_CAMERA, Camera, Scenario
from pipeline.workers import Worker

if TYPE_CHECKING:
    from pipeline.analysis.drop.results import Analysis
    from pipeline.stages.render import Rendering
    from pipeline.stages.simulate import Progress, Simulation

_DERIVED = (".analysis.rrd", ".gif", ".png")
"""How the files end that analyze and render put beside a recording."""


@dataclass(frozen=True)
class Run:
    """What the three stages made."""

    simulation: Simulation
    analysis: Analysis
    rendering: Rendering


def run(
    scenario: Scenario,
    out_dir: Path | str = "recordings",
    *,
    camera: Camera | None = STANDARD_CAMERA,
    at_s: Sequence[float] = (),
    animation: Animation = EVERY_FRAME,
    dark: bool = False,
    note: Callable[[str], None] = lambda _: None,
    progress: Progress = lambda *_: None,
) -> Run:
    """Simulate, analyze and render into a folder; a second run there is numbered, also meanwhile.

    Another process draws the frames and the plot, so that what the stages load and do takes place
    meanwhile.

    Raises
    ------
    ScenarioError
        If the body, a time, the frame rate or the speed cannot be used.
    OutputError
        If the folder or a file cannot be written.
    """
    with _reserved(Path(out_dir)) as path, Worker() as assistant:
        if camera is not None:
            assistant.ask("pipeline.engines.bullet.camera_frames:draw_ahead", scenario, camera)
        assistant.load("pipeline.figures.plot", "polars")
        from pipeline.stages.analyze import analyze
        from pipeline.stages.render import render
        from pipeline.stages.simulate import simulate

        simulation = simulate(
            scenario, path, camera=camera, note=note, progress=progress, assistant=assistant
        )
        analysis = analyze(path, at_s=at_s, progress=progress)
        rendering = render(
            path, animation=animation, dark=dark, progress=progress, assistant=assistant
        )
    return Run(simulation, analysis, rendering)


@contextlib.contextmanager
def _reserved(folder: Path) -> Iterator[Path]:
    """Yield the first of run.rrd, run-2.rrd, … of which nothing is there yet, for us alone.

    Its empty `.part` file, which only one process can make, keeps others away from it.
    """
    make_folder(folder, "--out-dir")
    for number in itertools.count(1):
        stem = "run" if number == 1 else f"run-{number}"
        path = folder / f"{stem}.rrd"
        part, made = part_of(path), (path, *(folder / f"{stem}{end}" for end in _DERIVED))
        if not any(map(os.path.lexists, (part, sealed_of(part), *made))) and reserved(path):
            if not any(map(os.path.lexists, made)):
                break
            part.unlink()  # another process has finished that number just now
    try:
        yield path
    except BaseException:
        with contextlib.suppress(OSError):  # it has its final name, or its folder is gone
            if not part.stat().st_size:
                part.unlink()
        raise

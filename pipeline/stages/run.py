"""The three stages in a row, with the recording handed from one to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import OutputError
from pipeline.figures.playback import EVERY_FRAME, Animation
from pipeline.recording.files import part_of
from pipeline.scenario import STANDARD_CAMERA, Camera, Scenario
from pipeline.workers import Worker

if TYPE_CHECKING:
    from pipeline.budget.results import Analysis
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
    """Simulate, analyze and render into a folder; a second run there is numbered.

    Another process draws the frames and the plot, so that what the stages load and do takes place
    meanwhile.

    Raises
    ------
    ScenarioError
        If the body, a time, the frame rate or the speed cannot be used.
    OutputError
        If the folder or a file cannot be written.
    """
    path = _next_name(Path(out_dir))
    with Worker() as assistant:
        if camera is not None:
            assistant.ask("pipeline.physics.pictures:draw_ahead", scenario, camera)
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


def _next_name(folder: Path) -> Path:
    """Return the first of run.rrd, run-2.rrd, … of which nothing is there yet."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"the folder {folder} cannot be made: {error.strerror}; choose another with --out-dir"
        ) from None
    number = 1
    while True:
        stem = "run" if number == 1 else f"run-{number}"
        path = folder / f"{stem}.rrd"
        made = (path, part_of(path), *(folder / f"{stem}{end}" for end in _DERIVED))
        if not any(one.exists() for one in made):
            return path
        number += 1

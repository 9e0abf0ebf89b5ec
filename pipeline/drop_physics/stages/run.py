"""The command `run`: simulates, analyzes and renders a drop."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.files.outputs import make_folder, reserved
from drop_physics.installed import PYBULLET, is_installed
from drop_physics.printable import Printable
from drop_physics.stages import verbs
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.workers import Worker

if TYPE_CHECKING:
    from drop_physics.analysis.results import Analysis
    from drop_physics.drop.results import DropAnalysis
    from drop_physics.stages.render import Rendering
    from drop_physics.stages.simulate import Simulation

_DERIVED = (".analysis.rrd", ".gif", ".png")
"""Suffixes of the files that analyze and render write next to a recording."""


@dataclass(frozen=True)
class Run(Printable, reported_by="drop_physics.report.run"):
    """The results of simulating, analyzing and rendering a drop."""

    simulation: Simulation
    analysis: DropAnalysis
    rendering: Rendering

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object of `--json`, with those of simulate, analyze and render."""
        parts = {"simulate": self.simulation, "analyze": self.analysis, "render": self.rendering}
        return {verb: made.as_json() for verb, made in parts.items()}


@takes_those_of(verbs.RunArguments)
def run(asked: verbs.RunArguments) -> Run:
    """Simulate, analyze and render a drop into a folder; further runs get numbered names.

    Another process draws the frames and the plot, while the stages load and run.

    Raises
    ------
    ScenarioError
        If the body, a time, the frame rate or the speed cannot be used.
    OutputError
        If the folder or a file cannot be written.
    """
    camera = asked.camera
    if camera is not None and not is_installed(PYBULLET):
        camera = None  # PyBullet draws the frames
    make_folder(Path(asked.out_dir))
    free = reserved(Path(asked.out_dir), "run", also=_DERIVED)
    analysis: Analysis | None = None

    def analyze_it() -> None:
        nonlocal analysis
        from drop_physics.stages.analyze import analyze  # with all rules

        analysis = analyze(path, at_s=asked.at_s, progress=asked.progress)

    with free as path, Worker() as assistant:
        if camera is not None:
            assistant.ask(
                "drop_physics.engines.pybullet.camera_frames:draw_ahead", asked.scenario, camera
            )
        assistant.load("drop_physics.figures.panel_plot")
        from drop_physics.drop.results import DropAnalysis
        from drop_physics.stages.render import render
        from drop_physics.stages.simulate import simulate

        simulation = simulate(
            asked.scenario,
            path,
            camera=camera,
            note=asked.note,
            progress=asked.progress,
            assistant=assistant,
        )
        # In the standard camera's frames, which golden recordings have, the body is a dot.
        near = camera is not None and camera.view == "standard"
        rendering = render(
            path,
            animation=asked.animation,
            dark=asked.dark,
            view="standard" if near else None,
            progress=asked.progress,
            assistant=assistant,
            meanwhile=analyze_it,
        )
    assert isinstance(analysis, DropAnalysis)  # of a drop
    return Run(simulation, analysis, rendering)

"""A drop, from its scenario to its pictures.

`simulate` drops a `Scenario` in PyBullet and writes everything that happens into one Rerun
recording, from which alone all else is computed: `analyze` breaks its error down, `render` makes a
gif and a plot. `run` does the three in a row, `sweep` does many drops. `check` compares a recording
with a golden one, and `info` describes one.

`record` records what a block of Python does with PyBullet, `record_script` what a script does;
`analyze_script`, `render_script` and `check_script` take these recordings.

    from pipeline import Scenario, simulate, analyze, render

A result prints as the terminal shows it; in a notebook it comes with its plot.

The names here are loaded on first use, so that importing the package is quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pipeline.analysis.drop.results import Analysis as Analysis
    from pipeline.analysis.script.results import ScriptAnalysis as ScriptAnalysis
    from pipeline.errors import DropError as DropError
    from pipeline.figures.playback import Animation as Animation
    from pipeline.scenario import Camera as Camera
    from pipeline.scenario import Scenario as Scenario
    from pipeline.stages.analyze import analyze as analyze
    from pipeline.stages.analyze_script import analyze_script as analyze_script
    from pipeline.stages.check import Check as Check
    from pipeline.stages.check import check as check
    from pipeline.stages.check_script import ScriptCheck as ScriptCheck
    from pipeline.stages.check_script import check_script as check_script
    from pipeline.stages.info import Info as Info
    from pipeline.stages.info import info as info
    from pipeline.stages.record import Recorded as Recorded
    from pipeline.stages.record import record_script as record_script
    from pipeline.stages.record_block import record as record
    from pipeline.stages.render import Rendering as Rendering
    from pipeline.stages.render import render as render
    from pipeline.stages.render_script import render_script as render_script
    from pipeline.stages.run import Run as Run
    from pipeline.stages.run import run as run
    from pipeline.stages.simulate import Simulation as Simulation
    from pipeline.stages.simulate import simulate as simulate
    from pipeline.stages.sweep import Sweep as Sweep
    from pipeline.stages.sweep import sweep as sweep
    from pipeline.sweeping.plan import Plan as Plan
    from pipeline.sweeping.plan import plan_of as plan_of

_HOMES = {
    "DropError": "pipeline.errors",
    "Scenario": "pipeline.scenario",
    "Camera": "pipeline.scenario",
    "Animation": "pipeline.figures.playback",
    "simulate": "pipeline.stages.simulate",
    "Simulation": "pipeline.stages.simulate",
    "analyze": "pipeline.stages.analyze",
    "Analysis": "pipeline.analysis.drop.results",
    "analyze_script": "pipeline.stages.analyze_script",
    "ScriptAnalysis": "pipeline.analysis.script.results",
    "check": "pipeline.stages.check",
    "Check": "pipeline.stages.check",
    "check_script": "pipeline.stages.check_script",
    "ScriptCheck": "pipeline.stages.check_script",
    "info": "pipeline.stages.info",
    "Info": "pipeline.stages.info",
    "record": "pipeline.stages.record_block",
    "record_script": "pipeline.stages.record",
    "Recorded": "pipeline.stages.record",
    "render": "pipeline.stages.render",
    "Rendering": "pipeline.stages.render",
    "render_script": "pipeline.stages.render_script",
    "run": "pipeline.stages.run",
    "Run": "pipeline.stages.run",
    "sweep": "pipeline.stages.sweep",
    "Sweep": "pipeline.stages.sweep",
    "Plan": "pipeline.sweeping.plan",
    "plan_of": "pipeline.sweeping.plan",
}

__all__ = list(_HOMES)


def __dir__() -> list[str]:
    return [*globals(), *__all__]  # what `dir`, `help` and the Tab key show


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'pipeline' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)

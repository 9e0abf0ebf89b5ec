"""Why did my simulation do that? Record PyBullet and MuJoCo, and read what went wrong.

    from drop_physics import analyze, record

    with record("run.rrd"):
        ...  # whatever steps a simulation
    analyze("run.rrd")

`record` records a block of Python that uses PyBullet or MuJoCo, `record_script` a script, and
`import_states` the states that another program has saved; `analyze` explains every step as a sum of
named impulses, and says what went wrong, the worst first, with the call that changes it. `why` runs
a script again with one thing changed at a time, `trust` with variations that should not matter.
`check` compares a recording with a golden one, `render` draws it, `export` writes it for other
tools, and `info` describes it.

`simulate` drops a box, as described by a `Scenario`, in either engine; `run` also analyzes and
renders the drop, and `sweep` makes many drops.

Printing a result shows the same text as on the terminal; in a notebook, its plot is shown, too.

The names here are loaded on first use, so that importing the package is quick.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drop_physics.analysis.results import Analysis as Analysis
    from drop_physics.drop.results import DropAnalysis as DropAnalysis
    from drop_physics.errors import DropError as DropError
    from drop_physics.figures.playback import Animation as Animation
    from drop_physics.scenario import Camera as Camera
    from drop_physics.scenario import Scenario as Scenario
    from drop_physics.stages.analyze import analyze as analyze
    from drop_physics.stages.block import record as record
    from drop_physics.stages.check import Check as Check
    from drop_physics.stages.check import check as check
    from drop_physics.stages.diff import Diff as Diff
    from drop_physics.stages.diff import diff as diff
    from drop_physics.stages.export import Export as Export
    from drop_physics.stages.export import export as export
    from drop_physics.stages.importing import Imported as Imported
    from drop_physics.stages.importing import import_states as import_states
    from drop_physics.stages.info import Info as Info
    from drop_physics.stages.info import info as info
    from drop_physics.stages.record import Recorded as Recorded
    from drop_physics.stages.record import record_script as record_script
    from drop_physics.stages.render import Rendering as Rendering
    from drop_physics.stages.render import render as render
    from drop_physics.stages.run import Run as Run
    from drop_physics.stages.run import run as run
    from drop_physics.stages.simulate import Simulation as Simulation
    from drop_physics.stages.simulate import simulate as simulate
    from drop_physics.stages.sweep import Sweep as Sweep
    from drop_physics.stages.sweep import sweep as sweep
    from drop_physics.stages.trust import Trust as Trust
    from drop_physics.stages.trust import trust as trust
    from drop_physics.stages.watch import watch as watch
    from drop_physics.stages.why import Why as Why
    from drop_physics.stages.why import why as why
    from drop_physics.sweeping.plan import Plan as Plan
    from drop_physics.sweeping.plan import plan_of as plan_of

    __version__: str

_HOMES = {
    "DropError": "drop_physics.errors",
    "Scenario": "drop_physics.scenario",
    "Camera": "drop_physics.scenario",
    "Animation": "drop_physics.figures.playback",
    "simulate": "drop_physics.stages.simulate",
    "Simulation": "drop_physics.stages.simulate",
    "analyze": "drop_physics.stages.analyze",
    "Analysis": "drop_physics.analysis.results",
    "DropAnalysis": "drop_physics.drop.results",
    "check": "drop_physics.stages.check",
    "Check": "drop_physics.stages.check",
    "diff": "drop_physics.stages.diff",
    "Diff": "drop_physics.stages.diff",
    "export": "drop_physics.stages.export",
    "Export": "drop_physics.stages.export",
    "import_states": "drop_physics.stages.importing",
    "Imported": "drop_physics.stages.importing",
    "info": "drop_physics.stages.info",
    "Info": "drop_physics.stages.info",
    "record": "drop_physics.stages.block",
    "record_script": "drop_physics.stages.record",
    "Recorded": "drop_physics.stages.record",
    "render": "drop_physics.stages.render",
    "Rendering": "drop_physics.stages.render",
    "run": "drop_physics.stages.run",
    "Run": "drop_physics.stages.run",
    "sweep": "drop_physics.stages.sweep",
    "Sweep": "drop_physics.stages.sweep",
    "trust": "drop_physics.stages.trust",
    "Trust": "drop_physics.stages.trust",
    "watch": "drop_physics.stages.watch",
    "why": "drop_physics.stages.why",
    "Why": "drop_physics.stages.why",
    "Plan": "drop_physics.sweeping.plan",
    "plan_of": "drop_physics.sweeping.plan",
}

__all__ = list(_HOMES)


def __dir__() -> list[str]:
    return [*globals(), *__all__]  # what `dir`, `help` and the Tab key show


def __getattr__(name: str) -> object:
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("drop-physics")
    if name not in _HOMES:
        raise AttributeError(f"module 'drop_physics' has no attribute {name!r}")
    before = dict(os.environ)
    try:
        return getattr(importlib.import_module(_HOMES[name]), name)
    finally:
        importlib.import_module("drop_physics.workers").note_changes(before)

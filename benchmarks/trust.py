"""Cost of `drop trust` and `drop why`: runs and their comparison, two in parallel.

The seven of `drop trust` are held against seven bare runs; of them `timestep/2` and `timestep/4`
make two and four times as many steps of the engine. Those of `drop why` are held against as many
commands that record the script.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, Measured, Ran, paired, process
from benchmarks.look import ARM

SCENE = """
import sys
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for joint in range(7):
    p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, 0.5, force=200)
for _ in range(int(sys.argv[1])):
    p.stepSimulation()
"""
RUNS = 7
"""Number of runs: the script's own, and the standard variations."""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes."""
    (folder / "scene.py").write_text(SCENE, encoding="utf-8")
    steps = 500 if quick else 100_000
    ratios, detail = paired(
        lambda: process(
            *DROP, "trust", "--jobs", 2, "--force", "--out", "out", "scene.py", steps, folder=folder
        ),
        lambda: _times(RUNS, sys.executable, "scene.py", steps, folder=folder),
        pairs=1 if quick else 3,
        warm=not quick,
    )
    yield Measured(
        f"`drop trust`, kuka, {steps:,} steps, 7 runs, 2 jobs",
        "the bare script seven times",
        ratios,
        1.6,
        detail=detail,
    )
    if quick:
        return
    shutil.copy(ARM, folder)
    why = (*DROP, "why", "--jobs", "2", "--force", "--out", "why", "arm.py")
    record = (*DROP, "record", "--force", "--out", "arm.rrd", "arm.py")
    found = folder / "why/arm.why/why.json"
    ratios, detail = paired(
        lambda: process(*why, folder=folder),
        lambda: _times(_runs(found), *record, folder=folder),
        pairs=3,
        warm=False,
    )
    yield Measured(
        f"`drop why`, an arm of 720 steps, {_runs(found)} runs, 2 jobs",
        "as many `drop record`",
        ratios,
        1.2,
        detail=detail,
    )


def _runs(found: Path) -> int:
    """Return the number of runs that `drop why` made."""
    return int(json.loads(found.read_text(encoding="utf-8"))["runs"])


def _times(count: int, *command: object, folder: Path) -> Ran:
    runs = [process(*command, folder=folder) for _ in range(count)]
    return Ran(
        sum(each.wall_s for each in runs),
        sum(each.cpu_s for each in runs),
        max(each.peak_mb for each in runs),
    )

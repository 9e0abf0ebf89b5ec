"""Cost of `drop trust`: seven runs and their comparison, two at a time, against seven bare runs.

Of these seven `timestep/2` and `timestep/4` make two and four times as many steps of the engine.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, Measured, Ran, paired, process

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
"""The script's own, and the usual variations."""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes."""
    (folder / "scene.py").write_text(SCENE, encoding="utf-8")
    steps = 10_000 if quick else 100_000
    ratios, detail = paired(
        lambda: process(
            *DROP, "trust", "--jobs", 2, "--force", "--out", "out", "scene.py", steps, folder=folder
        ),
        lambda: _seven_times(folder, steps),
        pairs=3,
        warm=not quick,
    )
    yield Measured(
        f"`drop trust`, kuka, {steps:,} steps, 7 runs, 2 jobs",
        "the bare script seven times",
        ratios,
        1.3,
        detail=detail,
    )


def _seven_times(folder: Path, steps: int) -> Ran:
    runs = [process(sys.executable, "scene.py", steps, folder=folder) for _ in range(RUNS)]
    return Ran(
        sum(each.wall_s for each in runs),
        sum(each.cpu_s for each in runs),
        max(each.peak_mb for each in runs),
    )

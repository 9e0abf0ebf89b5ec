"""What `drop record` costs a script per step, and `drop analyze` of what it recorded.

Each question takes a short and a long run of the same script: their difference is what the steps
take, without what starting takes.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, PYTHON, Measured, paired, process
from pipeline.recording.script_reader import read_script

SCENE = """
import sys
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
{load}
for _ in range(int(sys.argv[1])):
    p.stepSimulation()
"""
BOXES = """for number in range(100):
    p.loadURDF("cube_small.urdf", [0.2 * (number % 10), 0.2 * (number // 10), 0.025])"""
SCENES = {
    "one box": ('p.loadURDF("cube_small.urdf", [0, 0, 1])', 100_000),
    "kuka": ('p.loadURDF("kuka_iiwa/model.urdf", [0, 0, 0.1], useFixedBase=True)', 20_000),
    "laikago": ('p.loadURDF("laikago/laikago.urdf", [0, 0, 0.6])', 5_000),
}
"""What is loaded, and how many steps the longer run has."""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes."""
    for name, (load, steps) in SCENES.items():
        (folder / "scene.py").write_text(SCENE.format(load=load), encoding="utf-8")
        more_us, times = _per_step(folder, steps // 10 if quick else steps, pairs=3 if quick else 5)
        detail = f"{statistics.median(times):.3g} × the bare script"
        if name == "one box":
            yield Measured(
                f"`drop record`, {name}: more per step", "the bare script", more_us, 15, unit="µs",
                detail=detail,
            )  # fmt: skip
        else:
            goal = {"kuka": 1.35, "laikago": 1.25}[name]
            yield Measured(
                f"`drop record`, {name}, per step", "the bare script", times, goal,
                detail=f"{statistics.median(more_us):.3g} µs more",
            )  # fmt: skip
    (folder / "scene.py").write_text(SCENE.format(load=BOXES), encoding="utf-8")
    ratios, detail = paired(
        lambda: process(*DROP, "record", "--force", "--out", "boxes.rrd", "scene.py", 1000,
                        folder=folder),
        lambda: process(sys.executable, "scene.py", 1000, folder=folder),
        pairs=3 if quick else 5,
    )  # fmt: skip
    yield Measured(
        "`drop record`, 100 boxes resting on a floor, 1,000 steps", "the bare script", ratios, 2,
        detail=detail,
    )  # fmt: skip

"""Time of `drop SCRIPT` for ten walking robots at once, from the command to the answer."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, Measured, process

SCRIPT = """
import sys
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
robots = [p.loadURDF("a1/a1.urdf", [k, 0, 0.4]) for k in range(int(sys.argv[1]))]
for _ in range(int(sys.argv[2])):
    p.stepSimulation()
"""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Measure the processor time of whole processes, each beside the bare script."""
    robots, steps = (1, 24) if quick else (10, 240)
    (folder / "robots.py").write_text(SCRIPT, encoding="utf-8")
    ran = [
        (
            process(*DROP, "robots.py", robots, steps, folder=folder),
            process(sys.executable, "robots.py", robots, steps, folder=folder),
        )
        for _ in range(1 if quick else 3)
    ]
    bare_s = min(bare.cpu_s for _, bare in ran)
    yield Measured(
        f"`drop robots.py`, {robots} of Unitree's A1, {steps} steps: processor time",
        "",
        [ours.cpu_s for ours, _ in ran],
        10.0,
        unit="s",
        detail=f"the bare script takes {bare_s:.2g} s",
    )

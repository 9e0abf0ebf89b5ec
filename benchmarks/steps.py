"""A million steps without frames, beside a bare loop that keeps poses and velocities in lists."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, PYTHON, Measured, paired, process

BARE_LOOP = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
box = p.loadURDF("cube_small.urdf", [0, 0, 1])
poses, velocities = [], []
for _ in range({steps}):
    p.stepSimulation()
    poses.append(p.getBasePositionAndOrientation(box))
    velocities.append(p.getBaseVelocity(box))
"""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes; ours reads contacts too, and writes everything to the disk."""
    steps = 100_000 if quick else 1_000_000
    command = (*DROP, "simulate", "--no-camera", "--force", "--out", "run.rrd", "--duration",
               f"{steps}/240")  # fmt: skip
    ratios, detail = paired(
        lambda: process(*command, folder=folder).wall_s,
        lambda: process(*PYTHON, BARE_LOOP.format(steps=steps), folder=folder).wall_s,
        pairs=3 if quick else 5,
        warm=False,
    )
    yield Measured(
        f"`drop simulate --no-camera`, {steps:.0e} steps", "bare loop, kept in lists", ratios,
        1.25, detail=detail,
    )  # fmt: skip

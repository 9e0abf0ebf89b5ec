"""A million steps without frames, compared with bare loops that keep their values in lists."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, PYTHON, Measured, paired, process

BARE_LOOP = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
floor = p.loadURDF("plane.urdf")
box = p.loadURDF("cube_small.urdf", [0, 0, 1])
poses, velocities, contacts = [], [], []
for _ in range({steps}):
    p.stepSimulation()
    poses.append(p.getBasePositionAndOrientation(box))
    velocities.append(p.getBaseVelocity(box))
"""
AND_CONTACT = """
    points = p.getContactPoints(box, floor)
    contacts.append((len(points), min((point[8] for point in points), default=0.0),
                     sum(point[9] for point in points)))
"""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes; only ours writes to the disk."""
    steps = 5_000 if quick else 1_000_000
    command = (
        *DROP,
        "simulate",
        "--no-camera",
        "--force",
        "--out",
        "run.rrd",
        "--duration",
        f"{steps}/240",
    )
    loops = (
        (BARE_LOOP, "bare loop: step, pose, velocity", 1.25),
        (BARE_LOOP + AND_CONTACT.lstrip("\n"), "the same loop, contact too", 0.8),
    )
    for loop, what, goal in loops[1 if quick else 0 :]:
        ratios, detail = paired(
            lambda: process(*command, folder=folder),
            lambda loop=loop: process(*PYTHON, loop.format(steps=steps), folder=folder),  # type: ignore[misc]
            pairs=1 if quick else 5,
            warm=False,
        )
        yield Measured(
            f"`drop simulate --no-camera`, {steps:.0e} steps", what, ratios, goal, detail=detail
        )

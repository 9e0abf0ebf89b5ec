"""Cost of explaining an articulated body's step as a sum of impulses, against PyBullet's own step.

Microseconds a step depend on the machine; the ratio to PyBullet less so.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pybullet as p
from drop_physics.physics.laws.bullet.tree import sum_of

from benchmarks.harness import ROOT, Measured

sys.path.append(str(ROOT / "tests"))
from trees import Watched, described, engine, joints_of, load, run

PIECE = 1000
"""Number of steps in a chunk."""


def measure(_: Path, *, quick: bool) -> Iterator[Measured]:
    """Measure an arm driven in free space, and a standing robot with 18 degrees of freedom."""
    steps = 100 if quick else 10_000
    for file, height_m, fixed, goal_us in (
        ("kuka_iiwa/model.urdf", 0.0, True, 40.0),
        ("laikago/laikago_toes_zup_lores.urdf", 0.5, False, 60.0),
    ):
        with engine(floor=not fixed):
            body = load(file, at=(0, 0, height_m), fixed=fixed)
            watched = Watched(body, described(body))
            began = time.perf_counter()
            _drive(watched, steps)
            engine_us = (time.perf_counter() - began) / steps * 1e6
        taken = [_judged_us(watched, steps) for _ in range(1 if quick else 7)]
        size, contacts = watched.law.tree.size, len(watched.contacts)
        what = f"sum of impulses, {size} degrees of freedom, {steps:,} steps"
        yield Measured(what, "", taken, goal_us, "µs a step", detail=f"{contacts:,} contact points")
        yield Measured(
            what,
            "PyBullet's step, all read in Python",
            [one / engine_us for one in taken],
            detail=f"{engine_us:.0f} µs a step",
        )


def _drive(watched: Watched, steps: int) -> None:
    joints = joints_of(watched.body)

    def act(step: int) -> None:
        for joint in joints:
            where = 0.2 * math.sin(0.05 * step + joint)
            p.setJointMotorControl2(
                watched.body, joint, p.POSITION_CONTROL, targetPosition=where, force=60
            )

    run([watched], steps, act)


def _judged_us(watched: Watched, steps: int) -> float:
    """Return the time to explain a step, in chunks [µs]; building the arrays is excluded."""
    states, said = watched.states(), watched.reported()
    began = time.perf_counter()
    for first in range(0, steps, PIECE):
        last = min(first + PIECE, steps)
        sum_of(watched.law, states.at(slice(first, last + 1)), said.at(slice(first, last)))
    return (time.perf_counter() - began) / steps * 1e6

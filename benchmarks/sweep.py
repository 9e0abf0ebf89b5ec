"""2,000 drops by `drop sweep`, against the bare PyBullet loop over the same steps.

The bare loop does the minimum: one world per process, reset to the release 2,000 times; step, read
pose, read velocity, and keep nothing. Both sides are whole processes, so our time includes imports,
the start of workers, statistics and files.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, PYTHON, Measured, Ran, paired, process

BARE_LOOP = """
import os
children = []
for _ in range({jobs} - 1):
    child = os.fork()
    if child == 0:
        children = None
        break
    children.append(child)
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
box = p.loadURDF("cube_small.urdf", [0, 0, 1])
for _ in range({runs} // {jobs}):
    p.resetBasePositionAndOrientation(box, [0, 0, 1], [0, 0, 0, 1])
    p.resetBaseVelocity(box, [0, 0, 0], [0, 0, 0])
    for _ in range(240):
        p.stepSimulation()
        p.getBasePositionAndOrientation(box)
        p.getBaseVelocity(box)
for child in children or []:
    os.waitpid(child, 0)
"""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes, with one and two jobs, without and with recordings."""
    number = itertools.count()
    runs, pairs = (1000, 3) if quick else (2000, 7)

    def ours(jobs: int, *options: str, runs: int = runs) -> Ran:
        return process(
            *DROP,
            "sweep",
            "--out",
            f"sweep-{next(number)}",
            "--samples",
            runs,
            "--jobs",
            jobs,
            "--vary",
            "height=uniform:1:1.0001",  # --samples needs something to draw
            *options,
            folder=folder,
        )

    def bare(jobs: int) -> Ran:
        return process(*PYTHON, BARE_LOOP.format(runs=runs, jobs=jobs), folder=folder)

    for jobs, goal in ((1, 1.5), (2, 1.6)):
        ratios, detail = paired(lambda: ours(jobs, "--no-record"), lambda: bare(jobs), pairs=pairs)  # noqa: B023
        yield Measured(
            f"`drop sweep --no-record --jobs {jobs}`, {runs:,} drops",
            "bare loop",
            ratios,
            goal,
            detail=detail,
        )
    # Enough runs that starting the workers, about 0.4 s, does not hide how they scale.
    many = 5 * runs
    ratios, detail = paired(
        lambda: ours(1, "--no-record", runs=many),
        lambda: ours(2, "--no-record", runs=many),
        pairs=max(2, pairs // 2),
    )
    yield Measured(
        f"`drop sweep --no-record --jobs 1`, {many:,} drops: slower than two processes by",
        "`--jobs 2`",
        ratios,
        1.7,
        more_is_better=True,
        detail=detail,
    )
    ratios, detail = paired(lambda: ours(1), lambda: bare(1), pairs=max(2, pairs // 2))
    yield Measured(
        f"`drop sweep --jobs 1`, {runs:,} drops with a recording each",
        "bare loop",
        ratios,
        5.0,
        detail=detail,
    )

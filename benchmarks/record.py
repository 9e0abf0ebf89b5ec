"""Cost of `drop record` per step of a script, and of `drop analyze` on its recording.

Each question compares a short and a long run of the same script: the difference is the time of the
steps without start-up.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Iterator
from pathlib import Path

from drop_physics.recording.reader import read

from benchmarks.harness import DROP, PYTHON, Measured, Ran, paired, process

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
SCENES = {
    "one box": ('p.loadURDF("cube_small.urdf", [0, 0, 1])', 100_000),
    "kuka": ('p.loadURDF("kuka_iiwa/model.urdf", [0, 0, 0.1], useFixedBase=True)', 20_000),
    "laikago": ('p.loadURDF("laikago/laikago.urdf", [0, 0, 0.6])', 5_000),
}
"""What is loaded, and the number of steps."""


POLARS = """
import polars as pl
for name in ("states.parquet", "contacts.parquet"):
    print(pl.read_parquet(name).sum())
"""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes."""
    pairs, share = (3, 10) if quick else (5, 1)
    for name, (load, steps) in SCENES.items():
        _scene(folder, load)
        more_us, times = _per_step(folder, steps // share, pairs=pairs)
        if name == "one box":
            yield Measured(
                f"`drop record`, {name}: more per step", "the bare script", more_us, 15, unit="µs",
                detail=f"{statistics.median(times):.3g} times as long",
            )  # fmt: skip
        else:
            goal = {"kuka": 1.35, "laikago": 1.25}[name]
            yield Measured(
                f"`drop record`, {name}, per step", "the bare script", times, goal,
                detail=f"{statistics.median(more_us):.3g} µs more",
            )  # fmt: skip
    _scene(folder, boxes(100))
    piled = "`drop record`, 100 boxes resting on a floor"
    ratios, detail = paired(lambda: _record(folder, 1000), lambda: _bare(folder, 1000), pairs=pairs)
    yield Measured(f"{piled}, 1,000 steps", "the bare script", ratios, 2, detail=detail)
    _, times = _per_step(folder, 2000 // share, pairs=pairs)
    yield Measured(f"{piled}, per step", "the bare script", times)

    steps = 10_000 // share
    _record(folder, steps)
    seen = read(folder / "run.rrd").seen
    seen.states.write_parquet(folder / "states.parquet")
    seen.contacts.write_parquet(folder / "contacts.parquet")
    ratios, detail = paired(
        lambda: process(*DROP, "analyze", "--force", "run.rrd", folder=folder),
        lambda: process(*PYTHON, POLARS, folder=folder),
        pairs=3,
    )
    yield Measured(
        f"`drop analyze`, 100 bodies × {steps:,} steps", "polars: the same numbers from Parquet",
        ratios, 5, detail=detail,
    )  # fmt: skip
    for steps in (100_000,) if quick else (100_000, 1_000_000):
        _scene(folder, SCENES["one box"][0])
        yield Measured(
            f"`drop record`, one box, {steps:.0e} steps: peak memory", "",
            [_record(folder, steps).peak_mb], 300, unit="MB",
        )  # fmt: skip


def boxes(count: int) -> str:
    """Return lines that lay so many boxes on the floor."""
    return f"""for number in range({count}):
    p.loadURDF("cube_small.urdf", [0.2 * (number % 10), 0.2 * (number // 10), 0.025])"""


def _scene(folder: Path, load: str) -> None:
    (folder / "scene.py").write_text(SCENE.format(load=load), encoding="utf-8")


def _record(folder: Path, steps: int) -> Ran:
    return process(*DROP, "record", "--force", "--duration", "1e9", "--out", "run.rrd", "scene.py",
                   steps, folder=folder)  # fmt: skip


def _bare(folder: Path, steps: int) -> Ran:
    return process(sys.executable, "scene.py", steps, folder=folder)


def _per_step(folder: Path, steps: int, *, pairs: int) -> tuple[list[float], list[float]]:
    """Return the extra time per step [µs], and the ratio of step times, for each pair."""
    more_us, times = [], []
    for _ in range(pairs):
        ours_s, theirs_s = (
            run(folder, 2 * steps).wall_s - run(folder, steps).wall_s for run in (_record, _bare)
        )
        more_us.append((ours_s - theirs_s) / steps * 1e6)
        times.append(ours_s / theirs_s)
    return more_us, times

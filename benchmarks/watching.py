"""Cost of watching a script, per step and per call, without what the recording of it costs.

The script measures the processor time of its own thread: its events are read by another process,
and dropped.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from drop_physics.engines.bullet.script import Program, Script

from benchmarks.harness import Measured

SCRIPT = """
import sys, time
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
{load}
def run(n):
    for i in range(n):
        {call}
        p.stepSimulation()
run({steps} // 10)
began = time.thread_time()
run({steps})
print((time.thread_time() - began) / {steps} * 1e6)
"""
PLANE = 'p.loadURDF("plane.urdf")\n'
KUKA = 'b = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)'
BOXES = """for number in range(100):
    p.loadURDF("cube_small.urdf", [0.2 * (number % 10), 0.2 * (number // 10), 0.025])"""
BOX = 'b = p.loadURDF("cube_small.urdf", [0, 0, 0.03])'
FREE = 'b = p.loadURDF("cube_small.urdf", [0, 0, 1])'
SCENES = {
    "kuka": (KUKA, "pass", 20_000, 1.35),
    "laikago": (PLANE + 'p.loadURDF("laikago/laikago.urdf", [0, 0, 0.6])', "pass", 3_000, 1.15),
    "100 boxes at rest": (PLANE + BOXES, "pass", 500, 2.3),
    "kuka, commanded by 7 calls": (
        KUKA,
        "for j in range(7): p.setJointMotorControl2(b, j, p.POSITION_CONTROL, "
        "targetPosition=0.3 + 1e-4 * (i % 9) * j, force=200)",
        10_000, 1.8,
    ),
}  # fmt: skip
"""What is loaded, what is called before every step, steps, and how many times as long it may take.
"""
CALLS = {
    "a push": (FREE, "p.applyExternalForce(b, -1, [0.1, 0, i * 1e-9], [0, 0, 0], 2)"),
    "a reset of pose": (
        FREE, "p.resetBasePositionAndOrientation(b, [0, 0, 1 + i * 1e-9], [0, 0, 0, 1])"
    ),
    "a reset of velocity": (FREE, "p.resetBaseVelocity(b, [0, 0, i * 1e-9], [0, 0, 0])"),
    "an array of 7 motors": (
        KUKA,
        "p.setJointMotorControlArray(b, range(7), p.POSITION_CONTROL, "
        "targetPositions=[0, 0.8, i * 1e-9, -1.2, 0, 0.6, 0], forces=[300] * 7)",
    ),
}  # fmt: skip


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare steps within a process."""
    pairs, share = (3, 10) if quick else (5, 1)
    ours, theirs = _pairs(folder, PLANE + BOX, "pass", 40_000 // share, pairs)
    more = [mine - other for mine, other in zip(ours, theirs, strict=True)]
    yield Measured("watching one box: more per step", "the bare script", more, 12, unit="µs",
        detail=_over(ours, theirs))  # fmt: skip
    for name, (load, call, steps, goal) in SCENES.items():
        ours, theirs = _pairs(folder, load, call, steps // share, pairs)
        ratios = [mine / other for mine, other in zip(ours, theirs, strict=True)]
        yield Measured(f"watching {name}, per step", "the bare script", ratios, goal,
            detail=_over(ours, theirs))  # fmt: skip
    for name, (load, call) in CALLS.items():
        more = []
        for _ in range(pairs):
            (with_call,), (bare_with,) = _pairs(folder, load, call, 20_000 // share, 1)
            (without,), (bare_without,) = _pairs(folder, load, "pass", 20_000 // share, 1)
            more.append(with_call - without - (bare_with - bare_without))
        yield Measured(f"watching {name} every step: more per call", "the bare call", more, 5,
            unit="µs", detail=f"the call takes {bare_with - bare_without:.3g} µs")  # fmt: skip


def _pairs(
    folder: Path, load: str, call: str, steps: int, pairs: int
) -> tuple[list[float], list[float]]:
    """Return the time of a step [µs], watched and not, of each pair of runs."""
    path = folder / "scene.py"
    path.write_text(SCRIPT.format(load=load, call=call, steps=steps), encoding="utf-8")
    runs = [(_watched(path), _bare(path)) for _ in range(pairs)]
    return [mine for mine, _ in runs], [other for _, other in runs]


def _over(ours: list[float], theirs: list[float]) -> str:
    return f"{statistics.median(ours):.3g} over {statistics.median(theirs):.3g} µs"


def _bare(path: Path) -> float:
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def _watched(path: Path) -> float:
    printed = path.with_name("printed.txt")
    with printed.open("wb") as stdout, Path(os.devnull).open("wb") as stderr:
        program = Program(str(path), (), sys.executable)
        with Script(program, stdout=stdout.fileno(), stderr=stderr.fileno()) as script:
            for _ in script.events():
                pass
    return float(printed.read_text(encoding="utf-8").split()[-1])

"""Cost of watching a script, per step and per call; the cost of recording is excluded.

The script measures the processor time of its own thread: its events are read by another process,
and dropped.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from drop_physics.engines.script import Program, Script

from benchmarks.growth import boxes
from benchmarks.harness import DROP, Measured, process, worked

SCRIPT = """
import sys, time
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
{load}
bodies = [p.getBodyUniqueId(index) for index in range(p.getNumBodies())]
movable = [[j for j in range(p.getNumJoints(each)) if p.getJointInfo(each, j)[2] != 4]
           for each in bodies]
free = [each for each in bodies if p.getDynamicsInfo(each, -1)[0]]
jointed = [(each, joints) for each, joints in zip(bodies, movable) if joints]
log = []
def run(n, how):
    for i in range(n):
{call}
        p.stepSimulation()
        if how:
            poses = [(p.getBasePositionAndOrientation(each), p.getBaseVelocity(each))
                     for each in free]
            joints = [p.getJointStates(each, its) for each, its in jointed]
            row = poses, joints, p.getContactPoints()
            if how == "log":
                log.append(row)
run({steps} // 10, "")
began = time.thread_time()
run({steps}, sys.argv[-1] if len(sys.argv) > 1 else "")
print((time.thread_time() - began) / {steps} * 1e6)
"""
PLANE = 'p.loadURDF("plane.urdf")\n'
KUKA = 'b = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)'
LAIKAGO = PLANE + 'p.loadURDF("laikago/laikago.urdf", [0, 0, 0.6])'
BOX = 'b = p.loadURDF("cube_small.urdf", [0, 0, 0.03])'
FREE = 'b = p.loadURDF("cube_small.urdf", [0, 0, 1])'
MOTORS = """for j in range(7):
    p.setJointMotorControl2(b, j, p.POSITION_CONTROL, targetPosition=0.3 + 1e-4 * (i % 9) * j,
                            force=200)"""


@dataclass(frozen=True)
class Scene:
    """A script, and how much slower its steps may be when they are watched."""

    load: str
    call: str
    """The code that runs before every step."""
    steps: int
    goal: float
    """Limit relative to the bare step; for one box, an absolute limit on the extra time [µs]."""
    goal_logged: float | None = 1.0
    """Limit relative to a step with a hand-written logger."""
    both: float | None = None
    """Limit on the processor time of both processes of `drop record`, relative to a script that
    only makes the same reads."""


SCENES = {
    "one box": Scene(PLANE + BOX, "pass", 40_000, 10, both=1.3),
    "kuka": Scene(KUKA, "pass", 20_000, 1.5, both=1.2),
    "laikago": Scene(LAIKAGO, "pass", 3_000, 1.2, both=1.1),
    "100 boxes at rest": Scene(PLANE + boxes(100), "pass", 500, 1.9, both=1.1),
    "kuka, commanded by 7 calls": Scene(KUKA, MOTORS, 10_000, 1.6, 1.15, both=1.4),
    "a walker, 20 motors commanded": Scene(
        PLANE
        + """b = p.loadURDF("quadruped/minitaur.urdf", [0, 0, 0.3])
hinges = [j for j in range(p.getNumJoints(b)) if p.getJointInfo(b, j)[2] == 0]
hinges += hinges[:20 - len(hinges)]""",
        """for j in hinges[:20]:
    p.setJointMotorControl2(b, j, p.TORQUE_CONTROL, force=1e-3 * (i % 9))
p.getBasePositionAndOrientation(b), p.getBaseVelocity(b), p.getJointStates(b, hinges)""",
        3_000,
        1.8,
        None,
    ),
    "four drones": Scene(
        PLANE + """drones = [p.loadURDF("cube_small.urdf", [k, 0, 9]) for k in range(4)]""",
        """for b in drones:
    for rotor in range(4):
        p.applyExternalForce(b, -1, [0, 0, 1.2 + 1e-3 * (i % 9)], [0.1, 0, 0], p.LINK_FRAME)
    p.applyExternalTorque(b, -1, [0, 0, 1e-3], p.LINK_FRAME)
    p.getBasePositionAndOrientation(b), p.getBaseVelocity(b)""",
        10_000,
        2.5,
        None,
        both=1.8,
    ),
    "a reaching arm": Scene(
        KUKA,
        """at = [0.5, 0.1 * (i % 9) / 9, 0.5]
p.setJointMotorControlArray(b, range(7), p.POSITION_CONTROL,
    targetPositions=p.calculateInverseKinematics(b, 6, at))
p.getLinkState(b, 6), p.getJointStates(b, range(7))""",
        5_000,
        1.3,
        None,
    ),
}
READING = """for j in range(7):
    p.getJointState(b, j), p.getLinkState(b, j)"""
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
    """Compare watched and bare steps within a process."""
    pairs, share = (1, 100) if quick else (5, 1)
    for name, scene in [*SCENES.items()][: 1 if quick else None]:
        path = _written(folder, scene.load, scene.call, scene.steps // share)
        ways = (watched, bare, _logged, _reading)
        runs = [[way(path) for way in ways] for _ in range(pairs)]
        ours, theirs, logged, read = ([*times] for times in zip(*runs, strict=True))
        detail = f"{_over(ours, theirs)}; only reading the same: {_over(read, theirs)}"
        if name == "one box":
            more = [mine - other for mine, other in zip(ours, theirs, strict=True)]
            yield Measured(
                f"watching {name}: more per step",
                "the bare script",
                more,
                scene.goal,
                unit="µs",
                detail=detail,
            )
        else:
            ratios = [mine / other for mine, other in zip(ours, theirs, strict=True)]
            yield Measured(
                f"watching {name}, per step", "the bare script", ratios, scene.goal, detail=detail
            )
        if scene.goal_logged is not None:
            ratios = [mine / other for mine, other in zip(ours, logged, strict=True)]
            yield Measured(
                f"watching {name}, per step",
                "a logger written by hand",
                ratios,
                scene.goal_logged,
                detail=_over(ours, logged),
            )
    recorded = [(name, scene) for name, scene in SCENES.items() if scene.both is not None]
    for name, scene in recorded[: 1 if quick else None]:
        path = _written(folder, scene.load, scene.call, 5 * scene.steps // share)
        ratios, detail = worked(
            lambda path=path: process(
                *DROP, "record", "--force", "--out", "a.rrd", path, folder=folder
            ),  # type: ignore[misc]
            lambda path=path: process(sys.executable, path, "read", folder=folder),  # type: ignore[misc]
            pairs=1 if quick else 3,
        )
        yield Measured(
            f"`drop record`, {name}: processor time of both processes",
            "a script that reads the same, and keeps nothing",
            ratios,
            scene.both,
            detail=detail,
        )
    for name, (load, call) in [*CALLS.items()][: 1 if quick else None]:
        calls = [_of_call(folder, load, call, 20_000 // share) for _ in range(pairs)]
        yield Measured(
            f"watching {name} every step: more per call",
            "the bare call",
            [mine - other for mine, other in calls],
            3,
            unit="µs",
            detail=f"the call takes {calls[-1][1]:.3g} µs",
        )
    calls = [_of_call(folder, KUKA, READING, 10_000 // share) for _ in range(pairs)]
    yield Measured(
        "watching 14 reading calls a step",
        "the bare calls",
        [mine / other for mine, other in calls],
        1.2,
    )


def _of_call(folder: Path, load: str, call: str, steps: int) -> tuple[float, float]:
    """Return the time that calls add to a step [µs], watched and bare."""
    with_call = _written(folder, load, call, steps)
    watched_us, bare_us = watched(with_call), bare(with_call)
    without = _written(folder, load, "pass", steps)
    return watched_us - watched(without), bare_us - bare(without)


def _written(folder: Path, load: str, call: str, steps: int) -> Path:
    path = folder / "scene.py"
    call = textwrap.indent(call, "        ")
    path.write_text(SCRIPT.format(load=load, call=call, steps=steps), encoding="utf-8")
    return path


def _over(ours: list[float], theirs: list[float]) -> str:
    ours_us, theirs_us = statistics.median(ours), statistics.median(theirs)
    return f"{ours_us:.3g} over {theirs_us:.3g} µs ({ours_us / theirs_us:.3g} ×)"


def _logged(path: Path) -> float:
    """Return the time per step [µs] of a script that logs by hand."""
    return bare(path, "log")


def _reading(path: Path) -> float:
    """Return the time per step [µs] of a script that reads as much, and keeps nothing."""
    return bare(path, "read")


def bare(path: Path, *words: str) -> float:
    """Return the time that a script prints last."""
    command = [sys.executable, path, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def watched(path: Path) -> float:
    """Return the time that a script prints last when it is watched."""
    printed = path.with_name("printed.txt")
    with printed.open("wb") as stdout, Path(os.devnull).open("wb") as stderr:
        program = Program(str(path), (), sys.executable)
        with Script(program, stdout=stdout.fileno(), stderr=stderr.fileno()) as script:
            for _ in script.events():
                pass
    return float(printed.read_text(encoding="utf-8").split()[-1])

"""Cost of golden tests: pytest with the fixture `golden_recording`, compared with the tests alone.

Processor time, of which a machine under load takes little more; that of the process that records
is in it. A test drives a Panda beside a cube for a second, with a command per joint and step.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import Measured, process

SCENE = """
import pybullet as p, pybullet_data
def pick(target):
    p.connect(p.DIRECT)
    p.setAdditionalSearchPath(pybullet_data.getDataPath())
    p.setGravity(0, 0, -9.81)
    p.loadURDF("plane.urdf")
    arm = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
    p.loadURDF("cube_small.urdf", [0.5, 0, 0.025])
    for step in range(240):
        for joint in range(7):
            goal = target * step / 240
            p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, goal, force=87)
        p.stepSimulation()
    p.disconnect()
"""
MUJOCO = """
import mujoco
def pick(target):
    model = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom type="plane" size="1 1 1"/>'
        '<body name="box" pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
        '</worldbody></mujoco>')
    data = mujoco.MjData(model)
    data.qvel[3] = target
    for _ in range(240):
        mujoco.mj_step(model, data)
"""
BARE = """
def test_{number}():
    pick({number} / 10)
"""
GOLDEN = """
def test_{number}(golden_recording):
    with golden_recording("{number}"):
        pick({number} / 10)
"""
MORE = 4
"""Number of tests in addition to the first one; one in a smoke test."""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes."""
    goals = (("a Panda", SCENE, 3.0), ("a box in MuJoCo", MUJOCO, 1.0))
    for name, scene, goal_s in goals[1 if quick else 0 :]:
        its = folder / name.replace(" ", "_")
        its.mkdir()
        yield from _measured(its, name, scene, goal_s, *((1, 1) if quick else (MORE, 9)))


def _measured(
    folder: Path, name: str, scene: str, goal_s: float, more: int, pairs: int
) -> Iterator[Measured]:
    (folder / "scene.py").write_text(scene, encoding="utf-8")
    for kind, test in (("bare", BARE), ("golden", GOLDEN)):
        for count in (1, 1 + more):
            tests = [test.format(number=number) for number in range(count)]
            text = "\n".join(["from scene import pick", *tests])
            (folder / f"test_{kind}_{count}.py").write_text(text, encoding="utf-8")
    _cpu_s(folder, "golden", 1 + more, "--update-golden")
    first, further, detail = [], [], (0.0, 0.0, 0.0, 0.0)
    for _ in range(pairs):
        one, many = (_cpu_s(folder, "golden", count) for count in (1, 1 + more))
        bare, bare_many = (_cpu_s(folder, "bare", count) for count in (1, 1 + more))
        detail = one, bare, (many - one) / more, (bare_many - bare) / more
        first.append(one - bare)
        further.append(detail[2] - 1.5 * detail[3])
    yield Measured(
        f"first golden test of {name}: more processor time",
        "pytest with the bare test",
        first,
        goal_s,
        unit="s",
        detail="last pair: {:.2f} over {:.2f} s".format(*detail),
    )
    yield Measured(
        f"each further golden test of {name}: processor time beyond 1.5 × bare",
        "the bare test",
        further,
        0.5,
        unit="s",
        detail="last pair: {2:.2f} over {3:.2f} s".format(*detail),
    )


def _cpu_s(folder: Path, name: str, count: int, *options: str) -> float:
    without = [f"-pno:{plugin}" for plugin in ("cacheprovider", "hypothesispytest", "xdist")]
    tests = f"test_{name}_{count}.py"
    ran = process(sys.executable, "-m", "pytest", *without, *options, tests, folder=folder)
    return ran.cpu_s

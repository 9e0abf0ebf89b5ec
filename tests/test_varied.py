"""Differences between a variation of a run and the run itself.

Verification: a finer timestep is, to the last bit, the script written that way by hand; the script
reads and sees what it did before. What else is varied is in the engine, and not in what is read.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import some
from drop_physics.trace.events import Event, Samples, Settings
from watching import watched

pytestmark = pytest.mark.pybullet

HEAD = """
import math, time
import pybullet as p, pybullet_data
began = time.time()
p.connect(p.GUI)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
def step(*held):
    for _ in range(BY_HAND):
        for act in held:
            act()
        p.stepSimulation()
"""
"""`BY_HAND` is 1 in a script, and K in the same script written with a timestep of 1/K."""
BOX = """
p.loadURDF("plane.urdf")
box = p.loadURDF("cube_small.urdf", [0, 0, 0.2], [0.1, 0.2, 0, 1])
force = [1, 0, 2]
for i in range(60):
    force[1] = i / 60
    held = [lambda: p.applyExternalForce(box, -1, force, [0, 0.01, 0], p.LINK_FRAME),
        lambda: p.applyExternalTorque(box, -1, [0, 0.001, 0], flags=p.WORLD_FRAME)]
    step(*held[: i % 3])
"""
ARM = """
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
joints = range(p.getNumJoints(arm))
for i in range(60):
    held = []
    {command}
    step(*held)
"""
MODES = {
    "position": "p.setJointMotorControlArray(arm, joints, p.POSITION_CONTROL, [0.3] * len(joints))",
    "position limited": "p.setJointMotorControl2(arm, 1, p.POSITION_CONTROL, 1, force=30)",
    "velocity": "p.setJointMotorControl2(arm, 3, p.VELOCITY_CONTROL, targetVelocity=i / 60)",
    "pd": """
    for j in joints:
        p.setJointMotorControl2(arm, j, p.VELOCITY_CONTROL, force=0)
        p.setJointMotorControl2(arm, j, p.PD_CONTROL, 0.5, 0, 50, positionGain=9, velocityGain=1)
""",
    "torque": """
    p.setJointMotorControlArray(arm, joints, p.VELOCITY_CONTROL, forces=[0] * len(joints))
    held = [lambda: p.setJointMotorControlArray(arm, joints, p.TORQUE_CONTROL,
            forces=[math.sin(i)] * len(joints)),
        lambda: p.setJointMotorControl2(arm, 1, p.TORQUE_CONTROL, force=-3)]
""",
    "default": "",
}
WALKER = """
p.setTimeStep(1 / 500 / BY_HAND)
p.loadURDF("plane.urdf")
robot = p.loadURDF("laikago/laikago_toes.urdf", [0, 0, 0.48], [0, 0.5, 0.5, 0])
legs = [j for j in range(p.getNumJoints(robot)) if p.getJointInfo(robot, j)[2] == 0]
for i in range(150):
    for at, j in enumerate(legs):
        phase = 12 * i / 500 + (at // 3 in (0, 3)) * math.pi
        target = [0, 0.3 * math.sin(phase), -0.7 + 0.3 * math.cos(phase)][at % 3]
        p.setJointMotorControl2(robot, j, p.POSITION_CONTROL, target, force=20)
    step()
"""
PENDULUM = """
p.resetSimulation()
p.setPhysicsEngineParameter(fixedTimeStep=1 / 100 / BY_HAND, numSolverIterations=17)
box = p.loadURDF("cube_small.urdf")
held = p.createConstraint(box, -1, -1, -1, p.JOINT_POINT2POINT, [0, 0, 0], [0.1, 0, 0], [0.1, 0, 0])
p.changeConstraint(held, maxForce=2)
p.setGravity(0, 0, -5)
for i in range(60):
    step()
"""
SCRIPTS = {
    "box": BOX,
    **{mode: ARM.format(command=command) for mode, command in MODES.items()},
    "walker": WALKER,
    "pendulum": PENDULUM,
}


def script(text: str, by_hand: int = 1) -> str:
    """Return a script that makes a given number of engine steps for each of its own steps."""
    default = f"p.setTimeStep(1 / 240 / {by_hand})\n" if by_hand > 1 else ""
    return f"BY_HAND = {by_hand}\n{HEAD}{default}{text}"


def numbers(events: list[Event]) -> dict[str, np.ndarray[Any, Any]]:
    """Return all values sampled in a run."""
    parts = [event for event in events if isinstance(event, Samples)]
    found = {"contacts": np.concatenate([part.contacts for part in parts])}
    for body in {key for part in parts for key in (*part.bases, *part.joints)}:
        found[f"base {body}"] = np.concatenate(
            [part.bases[body] for part in parts if body in part.bases] or [np.empty(0)]
        )
        for name in ("position", "velocity", "effort"):
            found[f"{name} {body}"] = np.concatenate(
                [getattr(part.joints[body], name) for part in parts if body in part.joints]
                or [np.empty(0)]
            )
    return found


@pytest.mark.parametrize(
    ("name", "finer"), some([(name, (2, 4)[number % 2]) for number, name in enumerate(SCRIPTS)], 2)
)
def test_a_finer_timestep_is_the_script_written_that_way(
    tmp_path: Path, name: str, finer: int
) -> None:
    varied, ending, _ = watched(tmp_path, script(SCRIPTS[name]), variation={"finer": finer})
    assert (ending.how, ending.error) == ("finished", "")
    by_hand, ending, _ = watched(tmp_path, script(SCRIPTS[name], finer))
    assert (ending.how, ending.error) == ("finished", "")
    mine, theirs = numbers(varied), numbers(by_hand)
    assert mine.keys() == theirs.keys()
    for key, values in theirs.items():
        assert mine[key].tobytes() == values.tobytes(), key


READS = """
p.setTimeStep(0.01)
box = p.loadURDF("cube_small.urdf")
def look():
    print(p.getPhysicsEngineParameters(), time.time() - began, p.getDynamicsInfo(box, -1))
look()
p.setPhysicsEngineParameter(numSolverIterations=30, contactERP=0.3, solverResidualThreshold=1e-3)
p.changeDynamics(box, -1, lateralFriction=0.7)
p.changeDynamics(box, -1, mass=3)
look()
for _ in range(5):
    p.stepSimulation()
    time.sleep(0.003)
    look()
p.resetSimulation()
look_at = p.loadURDF("cube_small.urdf")
box = look_at
look()
p.setRealTimeSimulation(1)
time.sleep(0.1)
look()
"""
EVERYTHING = {
    "finer": 4,
    "iterations": 3,
    "engine": {"solverResidualThreshold": 0.0, "numSubSteps": 2},
    "gravity": 3.0,
    "friction": 0.25,
    "mass": 2.0,
}


def test_the_script_reads_what_it_has_set_and_its_own_clock(tmp_path: Path) -> None:
    _, _, plain = watched(tmp_path, script(READS), begins_s=1e9)
    events, _, printed = watched(tmp_path, script(READS), begins_s=1e9, variation=EVERYTHING)
    assert printed == plain
    assert plain.count("fixedTimeStep") == 9
    settings = [event.values for event in events if isinstance(event, Settings)]
    assert {each["fixedTimeStep"] for each in settings} == {0.01 / 4}
    assert settings[0]["numSolverIterations"] == 90
    assert settings[-1]["set_solverResidualThreshold"] == 0


IN_THE_ENGINE = """
p.loadURDF("plane.urdf")
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
box = p.loadURDF("cube_small.urdf", [1, 0, 0.2], [0.1, 0.2, 0, 1])
p.changeDynamics(box, -1, lateralFriction=0.7)
p.setPhysicsEngineParameter(numSolverIterations=2)
for _ in range(120):
    p.stepSimulation()
"""
CHANGES: dict[str, tuple[dict[str, Any], str]] = {
    "iterations": ({"iterations": 4}, "p.setPhysicsEngineParameter(numSolverIterations=8)"),
    "residual": (
        {"engine": {"solverResidualThreshold": 0.0}},
        "p.setPhysicsEngineParameter(solverResidualThreshold=0)",
    ),
    "gravity": ({"gravity": 3.0}, "p.setGravity(0, 0, -3)"),
    "friction": (
        {"friction": 0.25},
        "for b in range(3):\n  for j in range(-1, p.getNumJoints(b)):\n"
        "    p.changeDynamics(b, j, lateralFriction=p.getDynamicsInfo(b, j)[1] / 2)",
    ),
    "mass": (
        {"mass": 2.0},
        "for b in range(3):\n  for j in range(-1, p.getNumJoints(b)):\n"
        "    m, _, inertia, *_ = p.getDynamicsInfo(b, j)\n"
        "    if m: p.changeDynamics(b, j, mass=2 * m, "
        "localInertiaDiagonal=[2 * each for each in inertia])",
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", some(CHANGES, 1))
def test_what_is_varied_is_what_a_call_would_change(tmp_path: Path, name: str) -> None:
    variation, call = CHANGES[name]
    varied, _, _ = watched(tmp_path, script(IN_THE_ENGINE), variation=variation)
    called = IN_THE_ENGINE.replace("for _ in range(120)", f"{call}\nfor _ in range(120)")
    by_call, ending, _ = watched(tmp_path, script(called))
    assert ending.how == "finished"
    plain, _, _ = watched(tmp_path, script(IN_THE_ENGINE))
    mine, theirs, bare = numbers(varied), numbers(by_call), numbers(plain)
    for key, values in theirs.items():
        assert mine[key].tobytes() == values.tobytes(), key
    assert any(mine[key].tobytes() != values.tobytes() for key, values in bare.items())


NUDGED = """
p.loadURDF("plane.urdf")
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
human = p.loadURDF("humanoid/humanoid.urdf", [0, 2, 1])
box = p.loadURDF("cube_small.urdf", [1, 0, 0.2], [0.1, 0.2, 0, 1])
p.resetBaseVelocity(box, [1, 2, 3], [4, 5, 6])
for _ in range(3):
    p.stepSimulation()
p.resetSimulation()
box = p.loadURDF("cube_small.urdf", [1, 0, 0.2], [0.1, 0.2, 0, 1])
for _ in range(3):
    p.stepSimulation()
"""


@pytest.mark.long
def test_a_nudge_displaces_and_turns_all_that_moves_and_changes_no_velocity(tmp_path: Path) -> None:
    runs = [
        numbers(watched(tmp_path, script(NUDGED), variation=each)[0])
        for each in (None, {"nudge": 1e-9}, {"nudge": 1e-9}, {"nudge": 1e-9, "seed": 1})
    ]
    plain, nudged, again, other = runs
    for key, values in plain.items():
        assert nudged[key].tobytes() == again[key].tobytes(), key
        if key == "contacts" or not values.size:
            continue
        off = np.abs(nudged[key][0].tolist() - np.array(values[0].tolist()))
        if key.startswith("base"):
            assert (off[:3] > 0).all()
            assert (off[:3] < 1e-9).all()
            assert 0 < off[3:7].max() < 1e-9
            assert (off[7:] == 0).all()
            assert not np.array_equal(other[key][0], nudged[key][0])
        elif key.startswith("position"):
            assert 0 < off.max() < 1e-9
        elif key.startswith("velocity"):
            assert off.max() < 1e-15

"""Validation: half the timestep halves a robot's drift; overflow causes no warnings.

What else is said of the whole of a motion is in `corpus/attacks/whole.toml`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pybullet as p
import pytest
from asked import found as ask
from clients import release_clients
from conftest import some
from scenes import HEAD, analyze, record

SWAYING = """
import math
k = p.loadURDF("{file}", [0, 0, 2])
p.setTimeStep(1 / {rate})
J = [j for j in range(p.getNumJoints(k)) if p.getJointInfo(k, j)[2] == 0]
p.changeDynamics(k, -1, linearDamping=0, angularDamping=0)
for i in range(2 * {rate}):
    for j in J:
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, .8 * math.sin(6 * i / {rate}), force=200,
            positionGain=24 / {rate})
    p.stepSimulation()
"""
ITS_CENTRE = """
def centre(x=0, mass=0):
    for j in range(-1, p.getNumJoints(k)):
        m = p.getDynamicsInfo(k, j)[0]
        at = p.getLinkState(k, j, computeForwardKinematics=1) if j >= 0 else (
            p.getBasePositionAndOrientation(k))
        x, mass = x + m * np.array(at[0]), mass + m
    return x / mass
"""


@pytest.mark.long
@pytest.mark.parametrize(
    "file",
    some(["kuka_iiwa/model_free_base.urdf", "franka_panda/panda.urdf", "a1/a1.urdf"], 1),
)
def test_a_robot_that_sways_in_empty_space_drifts(file: str, tmp_path: Path) -> None:
    said, ways = [], []
    for rate in (240, 480):
        scene = SWAYING.format(file=file, rate=rate)
        (found,) = ask(scene, tmp_path, "momentum-drift")
        assert found.effect is not None
        said.append(found.effect.value)
        ways.append(np.linalg.norm(centre_of(scene) - centre_of(scene.split("for i in")[0])))
    assert said[0] == pytest.approx(2 * said[1], rel=0.15)
    assert ways[0] == pytest.approx(2 * ways[1], rel=0.2)


def centre_of(scene: str) -> Any:
    """Return the final position of the centre of mass of k in bare PyBullet."""
    names: dict[str, Any] = {}
    release_clients()
    exec(HEAD + "import numpy as np\n" + scene + ITS_CENTRE + "end = centre()", names)
    p.disconnect()
    return names["end"]


@pytest.mark.parametrize("how", ["", ", useMaximalCoordinates=True"])
@pytest.mark.parametrize(
    "call",
    some(
        [
            "p.changeDynamics(b, -1, linearDamping=0, maxJointVelocity=1e308)\n"
            "p.resetBaseVelocity(b, [1e200, 0, 0])",
            "p.resetBasePositionAndOrientation(b, [0, 0, 1e100], [0, 0, 0, 1])",
            "p.changeDynamics(b, -1, mass=float('inf'))",
            "p.changeDynamics(b, -1, localInertiaDiagonal=[float('nan'), 1, 1])",
            "p.setTimeStep(1e300)",
            "k = p.loadURDF('kuka_iiwa/model.urdf')\np.resetJointState(k, 2, 0, float('inf'))",
            "k = p.loadURDF('kuka_iiwa/model.urdf', useFixedBase=True)\n"
            "p.setJointMotorControl2(k, 2, p.POSITION_CONTROL, 1, positionGain=float('inf'))",
            "p.loadURDF('cube_small.urdf', globalScaling=1e300)",
        ],
        3,
    ),
)
def test_numbers_that_overflow_warn_nobody(call: str, how: str, tmp_path: Path) -> None:
    """Warnings are errors here, in recording and in analysis."""
    scene = f"p.setGravity(0, 0, -9.81)\nb = p.loadURDF('cube_small.urdf', [0, 0, 1]{how})\n"
    path = tmp_path / "overflow.rrd"
    analysis = analyze(record(scene + "steps(3)\n" + call + "\nsteps(6)", path).seen)
    assert not any("inf m " in str(each.message) for each in analysis.findings)


def test_a_throw_that_drag_would_stop_at_once_is_analyzed(tmp_path: Path) -> None:
    scene = """
b = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1))
p.changeDynamics(b, -1, maxJointVelocity=1e308)
steps(5)
p.resetBaseVelocity(b, [1e20, 0, 0])
steps(6)
"""
    (body,) = analyze(record(scene, tmp_path / "run.rrd").seen).bodies
    assert body.flights[-1].terms_m is None

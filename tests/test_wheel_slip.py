"""Validation: findings about slipping wheels agree with the slip in bare PyBullet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from asked import findings, told_in_pieces
from conftest import some
from contact_scenes import bare
from drop_physics.recording.reader import read
from drop_physics.rules.answer import Finding

HUSKY = """
p.setGravity(0, 0, -9.81)
plane = p.loadURDF("plane.urdf")
b = p.loadURDF("husky/husky.urdf", [0, 0, .13])
wheels, radius = [2, 3, 4, 5], .1651
steps(60)
for w in wheels:
    p.changeDynamics(b, w, lateralFriction={mu})
{before}
for i in range({steps}):
    speeds = {left}, {right}
    for w in wheels:
        p.setJointMotorControl2(b, w, p.VELOCITY_CONTROL, targetVelocity=speeds[w % 2], force=100)
    {each}
    p.stepSimulation()
rolled = [p.getJointState(b, w)[0] * radius for w in wheels]
"""
RACECAR = """
p.setGravity(0, 0, -9.81)
plane = p.loadURDF("plane.urdf")
p.changeDynamics(plane, -1, lateralFriction={mu})
b = p.loadURDF("racecar/racecar.urdf", [0, 0, .1])
wheels, radius = [2, 3, 5, 7], .05
for i in range(480):
    for w in wheels:
        p.setJointMotorControl2(b, w, p.VELOCITY_CONTROL, targetVelocity={speed}, force=10)
    for j in (4, 6):
        p.setJointMotorControl2(b, j, p.POSITION_CONTROL, {steer})
    p.stepSimulation()
rolled = [p.getJointState(b, w)[0] * radius for w in wheels]
"""
CART = """
import math
p.setGravity(9.81 * math.sin({slope}), 0, -9.81 * math.cos({slope}))
plane = p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[9, 9, .5]), -1,
    [0, 0, -.5])
p.changeDynamics(plane, -1, lateralFriction={mu})
wheel = p.createCollisionShape({shape}, radius=.1, height=.2)
wheels, radius = [0, 1, 2, 3], .1
b = p.createMultiBody(
    2, p.createCollisionShape(p.GEOM_BOX, halfExtents=[.2, .1, .05]), -1, [0, 0, {height}],
    [0, 0, 0, 1], linkMasses=[.5] * 4, linkCollisionShapeIndices=[wheel] * 4,
    linkVisualShapeIndices=[-1] * 4,
    linkPositions=[[x, y, {hang}] for x in (-.15, .15) for y in (-.25, .25)],
    linkOrientations=[[0, 0, 0, 1]] * 4, linkInertialFramePositions=[[0, 0, 0]] * 4,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 4, linkParentIndices=[0] * 4,
    linkJointTypes=[p.JOINT_REVOLUTE] * 4, linkJointAxis=[{axis}] * 4)
{before}
for w in wheels:
    p.changeDynamics(b, w, lateralFriction=1)
for i in range(480):
    for w in {driven}:
        p.setJointMotorControl2(b, w, p.VELOCITY_CONTROL, targetVelocity={speed}, force=20)
    {each}
    p.stepSimulation()
rolled = [p.getJointState(b, w)[0] * radius for w in wheels]
"""
TRIKE = """
p.setGravity(0, 0, -9.81)
plane = p.loadURDF("plane.urdf")
p.changeDynamics(plane, -1, lateralFriction={mu})
ball = [p.createCollisionShape(p.GEOM_SPHERE, radius=r) for r in (.1, .1, .04)]
wheels, radius = [0, 1], .1
b = p.createMultiBody(5, -1, -1, [0, 0, .12], [0, 0, 0, 1], linkMasses=[.5, .5, .1],
    linkCollisionShapeIndices=ball, linkVisualShapeIndices=[-1] * 3,
    linkPositions=[[.1, .2, -.02], [.1, -.2, -.02], [-.15, 0, -.08]],
    linkOrientations=[[0, 0, 0, 1]] * 3, linkInertialFramePositions=[[0, 0, 0]] * 3,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 3, linkParentIndices=[0] * 3,
    linkJointTypes=[p.JOINT_REVOLUTE] * 2 + [p.JOINT_FIXED], linkJointAxis=[[0, 1, 0]] * 3)
for i in range(480):
    for w in wheels:
        p.setJointMotorControl2(b, w, p.VELOCITY_CONTROL, targetVelocity=10, force=5)
    p.stepSimulation()
rolled = [p.getJointState(b, w)[0] * radius for w in wheels]
"""
LEVEL = {
    "slope": 0, "mu": 0.8, "height": 0.1, "hang": 0, "axis": [0, 1, 0], "before": "",
    "driven": "wheels", "shape": "p.GEOM_SPHERE", "speed": -8, "each": "pass",
}  # fmt: skip
HUSKY_AS_IT_IS = {
    "mu": 1,
    "before": "",
    "steps": 420,
    "left": 6,
    "right": 6,
    "each": "pass",
}
WALL = (
    "p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, 2, 1]), -1, "
    "[.8, 0, 1])"
)
LOAD = WALL.replace("(0,", "(400,", 1).replace("1])", "0.5])")
TIED = "p.createConstraint(b, -1, -1, -1, p.JOINT_POINT2POINT, [0, 0, 0], [0, 0, 0], [0, 0, .13])"
PLACED = "p.resetBasePositionAndOrientation(b, [i / 240, 0, .13], [0, 0, 0, 1])"
THERE_AND_BACK = "6 * (-1) ** (i // 60)"


def husky(**changed: object) -> str:
    return HUSKY.format(**HUSKY_AS_IT_IS | changed)


def cart(**changed: object) -> str:
    return CART.format(**LEVEL | changed)


SLIP = {
    "husky in a hurry": (husky(mu=0.2, left=20, right=20), husky(mu=2, left=20, right=20)),
    "racecar on ice": (
        RACECAR.format(mu=0.02, speed=20, steer=0), RACECAR.format(mu=2, speed=20, steer=0),
    ),
    "a caster that drags": (TRIKE.format(mu=0.05), TRIKE.format(mu=2)),
    "cart up a slope": (cart(slope=0.1, mu=0.12), cart(slope=0.1, mu=1)),
}  # fmt: skip
THEN_BACK = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
b = p.loadURDF("racecar/racecar.urdf", [0, 0, .2])
for n, speed in ((240, 0), (480, 20), (120, 0), (480, -20), (240, 0)):
    for j in (2, 3, 5, 7):
        p.setJointMotorControl2(b, j, p.VELOCITY_CONTROL, targetVelocity=speed, force=30)
    for j in (4, 6):
        p.setJointMotorControl2(b, j, p.POSITION_CONTROL, 0, force=200)
    steps(n)
"""
ROLL = {
    # Rolls 2 m each way and goes 2.03; its front wheels touch where it starts and brakes.
    "racecar there and back": THEN_BACK,
    "husky": husky(),
    "racecar": RACECAR.format(mu=1, speed=10, steer=0),
    "racecar in a curve": RACECAR.format(mu=1, speed=10, steer=0.4),
    "cart": cart(),
    "against a wall": husky(before=WALL),
    "against a load": husky(before=LOAD),
    "tied": husky(before=TIED),
    "placed by calls": husky(each=PLACED),
    "there and back": husky(left=THERE_AND_BACK, right=THERE_AND_BACK),
    "in a hurry against a wall": husky(mu=0.2, left=20, right=20, before=WALL),
    "brushes": cart(axis=[0, 0, 1], shape="p.GEOM_CYLINDER", mu=0.3),
    "other wheels are held by their default motors": cart(driven="[0, 1]", mu=0.3),
    "on its belly": cart(hang=0.06, height=0.05, mu=0.2),
}


def slips(scene: str, path: Path) -> list[Finding]:
    return [
        finding for finding in findings(scene, path / "scene.rrd") if finding.code == "wheel-slip"
    ]


@pytest.mark.long
@pytest.mark.parametrize("name", some(SLIP, 1))
def test_wheels_that_slip(name: str, tmp_path: Path) -> None:
    scene, cured = SLIP[name]
    (one,) = slips(scene, tmp_path)
    assert (one.level, one.advice is None) == ("asked", False)
    assert one.site is not None
    assert one.site.startswith("scene.py:")
    # How much of the way the wheels alone would have made.
    before, after = bare(scene), bare(cured)
    lost, kept = (
        1 - np.linalg.norm(each["where"][:2]) / np.abs(each["rolled"]).mean()
        for each in (before, after)
    )
    assert lost > 0.3
    assert one.share == pytest.approx(lost, abs=0.1)
    assert kept < 0.5 * lost
    said = told_in_pieces(read(tmp_path / "scene.rrd").seen)
    (other,) = (each for each in said if each.code == "wheel-slip")
    assert (other.message, other.steps) == (one.message, one.steps)
    assert all(slip.share < 0.6 * one.share for slip in slips(cured, tmp_path))


def test_locked_wheels_slide_on(tmp_path: Path) -> None:
    """The wheels speed up slowly, and stop at once: the car goes farther than they roll."""
    stops = "10 * min(1, i / 480) if i < 600 else 0"
    scene = husky(mu=0.3, steps=960, left=stops, right=stops)
    (one,) = slips(scene, tmp_path)
    ended = bare(scene)
    goes, rolled = np.linalg.norm(ended["where"][:2]), np.abs(ended["rolled"]).mean()
    assert goes > 1.05 * rolled
    assert one.share == pytest.approx(goes / rolled - 1, rel=0.3)


@pytest.mark.parametrize(("mu", "left", "right"), [(1, -5, 5), (0.2, -40, 40), (0.3, 2, 10)])
def test_a_turn_drags_wheels_sideways(mu: float, left: int, right: int, tmp_path: Path) -> None:
    (one,) = slips(husky(mu=mu, left=left, right=right), tmp_path)
    assert "sideways" in one.message
    assert one.advice is None  # more friction does not help


@pytest.mark.parametrize("name", some(ROLL, 2))
def test_wheels_that_roll_or_are_held(name: str, tmp_path: Path) -> None:
    assert not slips(ROLL[name], tmp_path)

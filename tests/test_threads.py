"""Causes of public threads, as scripts of their kind: what is said, and that its cure cures."""

from __future__ import annotations

from pathlib import Path

import pytest
from asked import codes, findings
from conftest import some

DOWN = "p.setGravity(0, 0, -9.81)\n"
PLANE = 'p.loadURDF("plane.urdf")\n'
KUKA = 'k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)\n'
SHAPES = """
def box(mass, at, half=.1):
    edges = half if isinstance(half, list) else [half] * 3
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=edges)
    return p.createMultiBody(mass, shape, -1, at)
def ball(mass, at, radius=.1):
    return p.createMultiBody(mass, p.createCollisionShape(p.GEOM_SPHERE, radius=radius), -1, at)
"""
WALL = """
w = box(0, [1.1, 0, 0], [.1, 1, 1])
b = ball(1, [0, 0, 0], .2)
for each in (w, b):
    p.changeDynamics(each, -1, restitution=1, linearDamping=0, angularDamping=0{more})
p.resetBaseVelocity(b, [1, 0, 0])
steps(240)
"""
TRAY = """
t = box(0, [0, 0, .5], [.5, .5, .02])
p.changeDynamics(t, -1, lateralFriction={mu})
b = box(1, [0, 0, .57], .05)
p.changeDynamics(b, -1, lateralFriction=1)
steps(60)
for i in range(120):
    p.resetBasePositionAndOrientation(t, [2 * (i / 240) ** 2, 0, .5], [0, 0, 0, 1])
    p.resetBaseVelocity(t, [4 * i / 240, 0, 0])
    p.stepSimulation()
"""
WHEELS = """
p.changeDynamics(0, -1, lateralFriction=.5)
c = p.loadURDF("racecar/racecar.urdf")
for j in (2, 3, 5, 7):
    p.setJointMotorControl2(c, j, p.VELOCITY_CONTROL, force=0)
for i in range(240):
    for j in (2, 3):
        p.setJointMotorControl2(c, j, p.TORQUE_CONTROL, force={torque})
    p.stepSimulation()
"""
FLOATING = """
import math
k = p.loadURDF("kuka_iiwa/model_free_base.urdf", [0, 0, 2])
for j in range(-1, 7):
    p.changeDynamics(k, j, linearDamping=0, angularDamping=0)
for i in range(480):
    where = [.8 * math.sin(i / 40) * {much}] * 7
    p.setJointMotorControlArray(k, range(7), p.POSITION_CONTROL, where, forces=[200] * 7)
    p.stepSimulation()
"""
SENT = """
for j, q in enumerate([0, .8, 0, -1.2, 0, .6, 0]):
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force={force})
steps({n})
"""
PENDULUM = """
b = p.createMultiBody(1, -1, -1, [0, 0, {z}], linkMasses=[1],
    linkCollisionShapeIndices=[-1], linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]],
    linkOrientations=[[0, 0, 0, 1]], linkInertialFramePositions=[[0, 0, -.5]],
    linkInertialFrameOrientations=[[0, 0, 0, 1]], linkParentIndices=[0],
    linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[1, 0, 0]])
p.createConstraint(b, -1, -1, -1, p.JOINT_FIXED, [0] * 3, [0] * 3, [0, 0, 2])
steps(30)
"""
LAID = """
r = p.loadURDF("laikago/laikago_toes.urdf", [0, 0, {z}], [0, .5, .5, 0])
p.resetBaseVelocity(r, [0] * 3, [0] * 3)
for j in range(p.getNumJoints(r)):
    p.resetJointState(r, j, 0)
steps(20)
"""
FALLS = DOWN + "f = box(0, [0, 0, 0], [2, 2, .05])\nb = box(1, [0, 0, .5])\n"
SHAPELESS = "p.createMultiBody(1, {shape}, -1, [0, 0, 1])\nsteps(200)\n"
STACK = DOWN + PLANE + SHAPES + "a = box(.2, [0, 0, .1])\nb = box(100, [0, 0, .3])\n"
R2D2 = 'r = p.loadURDF("r2d2.urdf", [0, 0, 10])\n'

SAID = {
    # What is left of the rebound is e v - gap / dt: 1 - 4.2e-3 * 240 < 0.
    "3094: a sticky wall": (
        SHAPES + WALL.format(more=""), "no-restitution", "before they touch",
        SHAPES + WALL.format(more=", contactProcessingThreshold=0"),
    ),
    # It takes m a = 4 N, but for the first step; 0.3 gives 2.9 N.
    "1936: a tray is fast": (
        DOWN + SHAPES + TRAY.format(mu=.3), "slides", "staying takes 3.97 N",
        DOWN + SHAPES + TRAY.format(mu=.6),
    ),
    # The base never spins faster than 3.7 rad/s.
    "2590: wheels spin": (
        DOWN + PLANE + WHEELS.format(torque=2), "velocity-clamped", "_rear_wheel_joint reaches",
        DOWN + PLANE + WHEELS.format(torque=.01),
    ),
    "4405: a floating arm drifts": (
        FLOATING.format(much=1), "momentum-drift", "gains 0.37", FLOATING.format(much=0),
    ),
    # It rests at 2.09 rad in the end; gravity takes 41 N m at 0.8.
    "2906: a weak arm, on its way": (
        DOWN + KUKA + SENT.format(force=30, n=120), "off-target", "the target takes 41 N m",
        DOWN + KUKA + SENT.format(force=200, n=480),
    ),
    "4166: a pendulum without shapes": (
        DOWN + PENDULUM.format(z=0), "constraint-apart", "2 m apart",
        DOWN + PENDULUM.format(z=2),
    ),
    "2442: legs in the ground": (
        DOWN + PLANE + LAID.format(z=.45), "starts-in-contact", "38.3 mm inside 0_plane",
        DOWN + PLANE + LAID.format(z=.6),
    ),
    "cairo 19: no shape": (
        DOWN + PLANE + SHAPES + SHAPELESS.format(shape=-1), "tunnelled", "no collision shape",
        DOWN + PLANE + SHAPES + "ball(1, [0, 0, 1])\nsteps(200)\n",
    ),
    "cairo 6: a pair that is off": (
        SHAPES + FALLS + "p.setCollisionFilterPair(f, b, -1, -1, 0)\nsteps(120)\n",
        "tunnelled", "p.setCollisionFilterPair switched this pair off",
        SHAPES + FALLS + "steps(120)\n",
    ),
    "dart 3442: 500 times as heavy": (
        STACK + "steps(240)", "deep-penetration", "500 times as heavy",
        STACK + "p.setPhysicsEngineParameter(numSolverIterations=5000)\nsteps(240)",
    ),
    "2655: a robot falls ever slower": (
        DOWN + R2D2 + "steps(480)", "default-damping", "0_r2d2 loses",
        DOWN + R2D2 + "p.changeDynamics(r, -1, linearDamping=0, angularDamping=0)\nsteps(480)",
    ),
}  # fmt: skip
"""Scene, code, words, and the scene cured."""


@pytest.mark.parametrize("what", some(SAID, 5))
def test_a_threads_cause_is_told(what: str, tmp_path: Path) -> None:
    scene, code, words, cured = SAID[what]
    (found,) = (each for each in findings(scene, tmp_path / "a.rrd") if each.code == code)
    assert words in found.message
    assert code not in codes(cured, tmp_path / "b.rrd")


JOINED = """
for j, q in enumerate([0, .6, 0, -1.2, 0, .8, 0]):
    p.resetJointState(k, j, q)
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=200)
x, y, z = p.getLinkState(k, 6, computeForwardKinematics=True)[0]
s = p.createCollisionShape(p.GEOM_CYLINDER, radius=.03, height=.2)
c = p.createMultiBody(.3, s, -1, [x, y, z - .16])
c = p.createConstraint(k, 6, c, -1, p.JOINT_FIXED, [0] * 3, [0] * 3, [0] * 3)
p.changeConstraint(c, maxForce=1000)
steps(240)
"""


def test_motors_that_react_to_a_constraint_are_not_blamed(tmp_path: Path) -> None:
    """Thread 1281: with frames that meet nothing shakes, with a tenth of the gain it still does."""
    found = codes(DOWN + PLANE + KUKA + JOINED, tmp_path / "a.rrd")
    assert found[0] == "constraint-apart"
    assert "unstable" not in found

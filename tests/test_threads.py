"""Problems from public forums, as scripts: the finding and the suggested change are right."""

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
SENT = """
for j, q in enumerate([0, .8, 0, -1.2, 0, .6, 0]):
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force={force})
steps({n})
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
    # It rests at 2.09 rad in the end; gravity takes 46 N m where it is, and 41 N m at 0.8.
    "2906: a weak arm, on its way": (
        DOWN + KUKA + SENT.format(force=30, n=120), "off-target", "way to its target takes up to",
        DOWN + KUKA + SENT.format(force=200, n=480),
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
"""Scene, code, text, and the corrected scene."""


@pytest.mark.parametrize("what", some(SAID, 2))
def test_a_threads_cause_is_told(what: str, tmp_path: Path) -> None:
    scene, code, words, cured = SAID[what]
    (found,) = (finding for finding in findings(scene, tmp_path / "a.rrd") if finding.code == code)
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
    """Thread 1281: mismatched constraint frames shake, even with a tenth of the motors' gain."""
    found = codes(DOWN + PLANE + KUKA + JOINED, tmp_path / "a.rrd")
    assert found[0] == "constraint-apart"
    assert "unstable" not in found

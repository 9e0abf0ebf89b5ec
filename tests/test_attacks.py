"""Right scripts, and some that are wrong for another reason than a first wording of a rule said.

Each was run with plain PyBullet before a rule was written down; what is true is in its comment.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from asked import findings
from conftest import some

DOWN = "p.setGravity(0, 0, -9.81)\n"
PLANE = 'p.loadURDF("plane.urdf")\n'
KUKA = 'k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)\n'
BOX = """
def box(mass, at, half=(.05, .05, .05), mu=.5):
    b = p.createMultiBody(mass, p.createCollisionShape(p.GEOM_BOX, halfExtents=half), -1, at)
    p.changeDynamics(b, -1, lateralFriction=mu)
    return b
"""
ASLEEP = DOWN + KUKA.replace("True", "True, flags=p.URDF_ENABLE_SLEEPING") + "steps(1200)\n"
TURNTABLE = """
p.setPhysicsEngineParameter(solverResidualThreshold=0, numSolverIterations=200)
disc = p.createCollisionShape(p.GEOM_CYLINDER, radius=.6, height=.04)
t = p.createMultiBody(0, -1, -1, [0, 0, 0], linkMasses=[5], linkCollisionShapeIndices=[disc],
    linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0], linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 0, 1]])
b = box(1, [.3, 0, .07])
p.changeDynamics(t, 0, lateralFriction=1)
for i in range(480):
    p.setJointMotorControl2(t, 0, p.VELOCITY_CONTROL, targetVelocity=2 * min(1, i / 240),
        force=1000)
    p.stepSimulation()
"""
FINGERS = """
k = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
for j in (9, 10):
    p.resetJointState(k, j, .04)
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, .04, force=20)
c = p.createConstraint(k, 9, k, 10, p.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0])
p.changeConstraint(c, gearRatio=-1, erp=.1, maxForce=50)
steps(60)
"""
CAR = """
c = p.loadURDF("racecar/racecar_differential.urdf", [0, 0, .1])
g = p.createConstraint(c, 9, c, 11, p.JOINT_GEAR, [0, 1, 0], [0, 0, 0], [0, 0, 0])
p.changeConstraint(g, gearRatio=1, maxForce=10000)
steps(60)
"""
KNEES = """
m = p.loadURDF("quadruped/minitaur.urdf", [0, 0, .2])
names = {p.getJointInfo(m, j)[1].decode(): j for j in range(p.getNumJoints(m))}
for leg in ("front_left", "front_right", "back_left", "back_right"):
    for side in "LR":
        p.resetJointState(m, names[f"motor_{leg}{side}_joint"], 1.57)
        p.resetJointState(m, names[f"knee_{leg}{side}_link"], -2.1834)
    p.createConstraint(m, names[f"knee_{leg}R_link"], m, names[f"knee_{leg}L_link"],
        p.JOINT_POINT2POINT, [0, 0, 0], [0, .005, .2], [0, .01, .2])
steps(30)
"""
CONVEYOR = """
t = box(0, [0, 0, .5], (1, .3, .05), mu=1)
b = box(1, [0, 0, .6], mu=1)
for i in range(240):
    p.resetBasePositionAndOrientation(t, [0, 0, .5], [0, 0, 0, 1])
    p.resetBaseVelocity(t, [.3, 0, 0], [0, 0, 0])
    p.stepSimulation()
"""
TOGETHER = """
t = box(0, [0, 0, .5], (.3, .3, .05))
b = box(1, [0, 0, .6])
for x in (0, .4):
    p.resetBasePositionAndOrientation(t, [x, 0, .5], [0, 0, 0, 1])
    p.resetBasePositionAndOrientation(b, [x, 0, .6], [0, 0, 0, 1])
    steps(120)
"""
TWO_ARMS = (
    DOWN
    + """
q0 = [0, 1, 0, -.8, 0, .5, 0]
arms = [p.loadURDF("kuka_iiwa/model.urdf", [0, y, 0], useFixedBase=True) for y in (-.3, .3)]
for k in arms:
    for j in range(7):
        p.resetJointState(k, j, q0[j])
ends = [p.getLinkState(k, 6, computeForwardKinematics=True)[0] for k in arms]
middle = [sum(each) / 2 for each in zip(*ends)]
half = [.02, .2, .02]
bar = p.createMultiBody(8, p.createCollisionShape(p.GEOM_BOX, halfExtents=half), -1, middle)
p.setCollisionFilterGroupMask(bar, -1, 0, 0)
for k, y in zip(arms, (-.3, .3)):
    p.createConstraint(k, 6, bar, -1, p.JOINT_POINT2POINT, [0, 0, 0], [0, 0, 0], [0, y, 0])
for k in arms:
    for j in range(7):
        weak = k == arms[0] and j == 1
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q0[j], force=40 if weak else 300)
steps(720)
"""
)
DOUBLE = """
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.025, .025, .5])
b = p.createMultiBody(0, linkMasses=[1, 1], linkCollisionShapeIndices=[s, s],
    linkVisualShapeIndices=[-1, -1], linkPositions=[[0, 0, 0], [0, 0, -1]],
    linkOrientations=[[0, 0, 0, 1]] * 2, linkInertialFramePositions=[[0, 0, -.5]] * 2,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2, linkParentIndices=[0, 1],
    linkJointTypes=[p.JOINT_REVOLUTE] * 2, linkJointAxis=[[0, 1, 0]] * 2)
for j, q in enumerate((2.5, .6)):
    p.resetJointState(b, j, q)
    p.setJointMotorControl2(b, j, p.VELOCITY_CONTROL, force=0)
steps(600)
"""
DOMINOES = """
row = [box(.1, [.04 * i, 0, .05], (.005, .025, .05)) for i in range(6)]
steps(60)
p.resetBaseVelocity(row[0], [.3, 0, 0], [0, 3, 0])
steps(240)
"""
R2D2 = """
p.changeDynamics(0, -1, restitution=.9)
r = p.loadURDF("r2d2.urdf", [0, 0, .8])
p.changeDynamics(r, -1, restitution=.9)
steps(200)
"""
GRAVITY_ALONE = """
for j, q in enumerate([0, .8, 0, -1.2, 0, .6, 0]):
    p.resetJointState(k, j, q)
for i in range(120):
    q = [each[0] for each in p.getJointStates(k, range(7))]
    torques = p.calculateInverseDynamics(k, q, [0.] * 7, [0.] * 7)
    p.setJointMotorControlArray(k, range(7), p.TORQUE_CONTROL, forces=torques)
    p.stepSimulation()
"""
ANIMATED = """
g = p.loadURDF("pr2_gripper.urdf", [0, 0, 1])
for i in range(120):
    p.resetBasePositionAndOrientation(g, [.005 * i, 0, 1], [0, 0, 0, 1])
    p.stepSimulation()
"""

SILENT = {
    # Joint 2 comes to 0.0 rad off within 3 s; no limit cycle.
    "an arm with little force to spare": (
        DOWN + KUKA + "for j, q in enumerate([0, .8, 0, -1.2, 0, .6, 0]):\n"
        "    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=60)\nsteps(720)",
        {"unstable", "motor-gain", "off-target"},
    ),
    # It moves with the table: by poses 6 mm of drift a radian, by velocities nothing.
    "a box on a turntable": (
        DOWN + BOX + TURNTABLE, {"slides", "creeps", "dragged-by-nothing"}
    ),
    "a gear between fingers": (DOWN + FINGERS, {"constraint-apart"}),
    "a gear of a car": (DOWN + PLANE + CAR, {"constraint-apart"}),
    "knees that are closed": (DOWN + PLANE + KNEES, {"constraint-apart"}),
    # The box goes 0.3 m in a second with the belt.
    "a belt": (DOWN + BOX + CONVEYOR, {"dragged-by-nothing", "slides", "starts-in-contact"}),
    "a table set together with its load": (
        DOWN + BOX + TOGETHER, {"dragged-by-nothing", "slides", "starts-in-contact"}
    ),
    "a double pendulum": (DOWN + DOUBLE, {"unstable", "energy-gained"}),
    "dominoes": (
        DOWN + PLANE + BOX + DOMINOES, {"slides", "creeps", "energy-gained", "starts-in-contact"}
    ),
    # Wheels touch, whose restitution is 0.
    "links without restitution": (DOWN + PLANE + R2D2, {"no-restitution"}),
    # The joints stay, as asked: their motors give 1e-13 N m.
    "gravity compensated under default motors": (DOWN + KUKA + GRAVITY_ALONE, {"default-motor"}),
    "a hand that is animated": (
        DOWN + ANIMATED, {"reset-leaves", "starts-in-contact", "deep-penetration"}
    ),
    "a push on the base of a fixed arm": (
        DOWN + KUKA + "for _ in range(60):\n"
        "    p.applyExternalForce(k, -1, [50, 0, 0], [0, 0, 0], p.LINK_FRAME)\n    steps(1)",
        {"asleep"},
    ),
    "a mass that is pushed, and has none": (
        DOWN + BOX + "b = box(0, [0, 0, 1])\nfor _ in range(60):\n"
        "    p.applyExternalForce(b, -1, [50, 0, 0], [0, 0, 0], p.LINK_FRAME)\n    steps(1)",
        {"asleep"},
    ),
}  # fmt: skip
"""Scene, and what is not said of it."""


@pytest.mark.parametrize("what", some(SILENT, 6))
def test_a_right_script_is_not_blamed(what: str, tmp_path: Path) -> None:
    scene, never = SILENT[what]
    found = [each for each in findings(scene, tmp_path / "a.rrd") if each.level != "note"]
    assert [each.message for each in found if each.code in never] == []


PISTON = """
h = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.05, .05, .05])
s = p.createMultiBody(0, -1, -1, [{at}], linkMasses=[8], linkCollisionShapeIndices=[h],
    linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0], linkJointTypes=[p.JOINT_PRISMATIC], linkJointAxis=[[{axis}]])
def send(force):
    p.setJointMotorControl2(s, 0, p.POSITION_CONTROL, .5, force=force)
    steps(480)
"""
MEANT = {
    # As in a hundred gyms: at its place the cart's rate changes its sign with every step.
    "a cart that is switched": (
        "p.setTimeStep(.02)\n"
        'c = p.loadURDF("cartpole.urdf")\n'
        "for j in (0, 1): p.setJointMotorControl2(c, j, p.VELOCITY_CONTROL, force=0)\n"
        "for _ in range(100):\n"
        "    push = -10 if p.getJointState(c, 0)[1] > 0 else 10\n"
        "    p.setJointMotorControl2(c, 0, p.TORQUE_CONTROL, force=push)\n"
        "    p.stepSimulation()",
        "unstable",
    ),
    # Every answer of an IK differs in its last digits: the joint reaches what it is sent to.
    "targets that hardly change": (
        KUKA + "for i in range(300):\n"
        "    p.setJointMotorControl2(k, 1, p.POSITION_CONTROL, .8 + 1e-4 * .9 ** i, force=100)\n"
        "    p.stepSimulation()",
        "off-target",
    ),
    # The script lets it settle before it sends it anywhere.
    "an arm that waits": (
        KUKA + "p.resetJointState(k, 1, .5)\nsteps(60)\nfor j in range(7):\n"
        "    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, .4, force=300)\nsteps(60)",
        "default-motor",
    ),
    # A ball of half the mass has half the inertia.
    "a mass that is set": (
        'b = p.loadURDF("sphere2.urdf", [0, 0, 3], globalScaling=.4)\n'
        "p.changeDynamics(b, -1, mass=5)\n"
        "for _ in range(60):\n"
        "    p.applyExternalTorque(b, -1, [.5, 0, 0], p.WORLD_FRAME)\n    p.stepSimulation()",
        "inertia-from-shape",
    ),
    "a copy to plan in": (
        KUKA + "other = p.connect(p.DIRECT)\n"
        "p.setGravity(0, 0, -9.81, physicsClientId=other)\n"
        "p.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=other)\n"
        'p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True, physicsClientId=other)\n'
        "p.resetJointState(0, 1, .5, physicsClientId=other)\n"
        "for _ in range(9): p.stepSimulation(physicsClientId=0)\n"
        "p.disconnect(other)",
        "not-stepped",
    ),
}  # fmt: skip
"""Scene, and the code that an earlier wording of its rule had."""


@pytest.mark.parametrize("what", MEANT)
def test_what_is_meant_is_not_said(what: str, tmp_path: Path) -> None:
    scene, code = MEANT[what]
    found = findings(DOWN + scene, tmp_path / "a.rrd")
    assert [each.message for each in found if each.code == code] == []


SAID = {
    # Friction takes 4.9 N.
    "a pusher that is too weak": (
        DOWN + PLANE + BOX + PISTON.format(axis="1, 0, 0", at="-.2, 0, .1")
        + "box(1, [-.09, 0, .05])\nsend(3)",
        "off-target", "its motor is at its limit of 3 N against 2_box",
    ),
    # 0 rad in the end: the command does not wake it.
    "an arm that sleeps is sent": (
        ASLEEP + "for j in range(7):\n"
        "    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, .5, force=300)\nsteps(60)",
        "asleep", "most of all motors",
    ),
    "an arm that sleeps is given torques": (
        ASLEEP + "for j in range(7):\n"
        "    p.setJointMotorControl2(k, j, p.VELOCITY_CONTROL, force=0)\n"
        "for _ in range(60):\n"
        "    p.setJointMotorControl2(k, 0, p.TORQUE_CONTROL, force=50)\n    steps(1)",
        "asleep", "most of all applied",
    ),
    # The other arm takes what the weak one leaves: what it needs is not determined.
    "a weak arm that shares a load": (
        TWO_ARMS, "off-target", "its motor is at its limit of 40 N m in 720 of 720 steps"
    ),
    "a constraint that is gone after a restore": (
        DOWN + BOX + "b = box(1, [0, 0, 2])\n"
        "c = p.createConstraint(b, -1, -1, -1, p.JOINT_FIXED, [0] * 3, [0] * 3, [0, 0, 2])\n"
        "steps(10)\ns = p.saveState()\nsteps(60)\np.removeConstraint(c)\nsteps(30)\n"
        "p.restoreState(s)\nsteps(60)",
        "restore-differs", "p.removeConstraint",
    ),
    "wheels that roll on after a reset": (
        DOWN + PLANE + 'c = p.loadURDF("racecar/racecar.urdf", [0, 0, .2])\n'
        "for j in (2, 3, 5, 7):\n"
        "    p.setJointMotorControl2(c, j, p.VELOCITY_CONTROL, targetVelocity=20, force=10)\n"
        "steps(120)\np.resetBasePositionAndOrientation(c, [0, 0, .2], [0, 0, 0, 1])\nsteps(20)",
        "reset-leaves", "still turns at 20 rad/s",
    ),
}  # fmt: skip
"""Scene, code, words."""


@pytest.mark.parametrize("what", some(SAID, 4))
def test_what_is_true_is_said(what: str, tmp_path: Path) -> None:
    scene, code, words = SAID[what]
    (found,) = (each for each in findings(scene, tmp_path / "a.rrd") if each.code == code)
    assert words in found.message

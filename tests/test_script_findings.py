"""What `drop analyze` finds in a script's recording: each with its body, step and line.

Each finding has a scene that provokes it, and one in which its advice was followed: it is gone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
import pytest
import scenes
from altered import otherwise
from drop_physics.analysis.script.results import ScriptAnalysis
from drop_physics.recording.reader import Recording
from scenes import analyze, codes, found, site


class Case(NamedTuple):
    """A scene that provokes a finding; what is said of it; and the same with its advice taken."""

    code: str
    scene: str
    body: str | None
    step: int | None
    line: int | None
    """Of the call that caused it."""
    remedied: str


GRAVITY = "p.setGravity(0, 0, -9.81)\n"
FLOOR = GRAVITY + 'p.loadURDF("plane.urdf")\n'
CUBE = 'b = p.loadURDF("cube_small.urdf", [0, 0, {}])\n'
BOX = (
    "b = p.createMultiBody({}, p.createCollisionShape(p.GEOM_BOX, halfExtents=[{}]), "
    "basePosition=[{}])\n"
)
FLOOR_4_MM = (
    GRAVITY + "p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[1, 1, .002]))\n"
)
SHAPELESS = """
import tempfile
with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
    file.write('<robot name="u"><link name="u"><inertial><mass value="1"/><inertia ixx="1" ixy="0" '
        'ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link></robot>')
    file.flush()
    p.loadURDF(file.name, [0, 0, .05], flags=p.URDF_USE_INERTIA_FROM_FILE)
steps(40)
"""
WALL = GRAVITY + BOX.format("0", "0.005, 1, 1", "1, 0, 0.5") + "wall = b\n"
BULLET = BOX.format("1", "0.02, 0.02, 0.02", "0, 0, 0.5") + "p.resetBaseVelocity(b, [90, 0, 0])\n"
ABOVE = (
    "c = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02] * 3, "
    "collisionFramePosition=[0, 0, 3])\nb = p.createMultiBody(1, c, basePosition=[{}])\n"
    "p.resetBaseVelocity(b, [90, 0, 0])\nsteps(8)"
)
ROBOT = GRAVITY + 'r = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)\n'
HEAD = (
    FLOOR + 'r = p.loadURDF("r2d2.urdf", [0, 0, 0.5])\n'
    "p.setJointMotorControl2(r, 13, p.VELOCITY_CONTROL, targetVelocity=3, force=100)\n"
)  # fmt: skip
DRIVEN = "p.setJointMotorControl2(r, 1, p.POSITION_CONTROL, targetPosition=1, force={})\n"
INERTIA = (
    GRAVITY + BOX.format("1", "0.05, 0.05, 0.05", "0, 0, 1")
    + "p.changeDynamics(b, -1, linearDamping=0)\n"
    "p.changeDynamics(b, -1, localInertiaDiagonal=[{}])\n"
    "p.changeDynamics(b, -1, lateralFriction=1)\nsteps(2)"
)  # fmt: skip
RESTITUTION = "for number in (0, b): p.changeDynamics(number, -1, restitution={})\n"
BOUNCE = FLOOR + CUBE.format(0.202) + RESTITUTION.format(1)
PILE = (
    FLOOR
    + """p.setPhysicsEngineParameter(numSolverIterations={})
for i in range(8): p.loadURDF("cube_small.urdf", [0, 0, 0.0249 + 0.0499 * i])
p.changeDynamics(8, -1, mass=5)
steps(60)
"""
)
RIGID = 'b = p.loadURDF("cube_small.urdf", useMaximalCoordinates=True)\n'
STACK = (
    FLOOR + BOX.format("1", "0.05, 0.05, 0.05", "0, 0, 0.05") + BOX.format("{}", "0.05, 0.05, 0.05",
    "0, 0, 0.16") + "steps(60)"
)  # fmt: skip
CHAIN = (
    GRAVITY
    + """s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
p.createMultiBody(1, s, basePosition=[0, 0, 1], linkMasses=[1, 1], flags={},
    linkCollisionShapeIndices=[s, s], linkVisualShapeIndices=[-1] * 2,
    linkPositions=[[0, 0, 0.3], [0, 0, -0.2]], linkOrientations=[[0, 0, 0, 1]] * 2,
    linkInertialFramePositions=[[0, 0, 0]] * 2,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2, linkParentIndices=[0, 1],
    linkJointTypes=[p.JOINT_REVOLUTE] * 2, linkJointAxis=[[0, 1, 0]] * 2)
steps(3)
"""
)
WINDOW = "p.disconnect()\np.connect(p.GUI)\n" + GRAVITY + BOX.format("1", "1, 1, 1", "0, 0, 9")

CASES = [
    Case(
        "not-stepped", FLOOR + CUBE.format(1), None, None, None,
        FLOOR + CUBE.format(1) + "steps(1)",
    ),
    Case(
        "no-gravity", CUBE.format(1) + "steps(5)", None, None, None,
        GRAVITY + CUBE.format(1) + "steps(5)",
    ),
    Case(
        "default-damping", GRAVITY + CUBE.format(3) + "steps(80)", "0_cube_small", 0, None,
        GRAVITY + CUBE.format(3) + "p.changeDynamics(b, -1, linearDamping=0)\nsteps(80)",
    ),
    Case(
        "timestep-too-long", FLOOR + CUBE.format(2) + "p.setTimeStep(0.05)\nsteps(15)",
        "1_cube_small", 13, None, FLOOR + CUBE.format(2) + "p.setTimeStep(0.005)\nsteps(150)",
    ),
    Case(
        "timestep-too-long", WALL + BULLET + "p.setPhysicsEngineParameter(numSubSteps=4)\nsteps(2)",
        "1_box", 1, None, WALL + BULLET + "p.setPhysicsEngineParameter(numSubSteps=20)\nsteps(2)",
    ),
    Case(
        "deep-penetration", FLOOR + CUBE.format(1) + "steps(150)", None, 109, None,
        FLOOR + CUBE.format(1) + "p.setTimeStep(1 / 1000)\nsteps(600)",
    ),
    Case(
        "deep-penetration",
        FLOOR + CUBE.format(0.1)
        + "p.changeDynamics(b, -1, contactStiffness=30, contactDamping=1)\nsteps(100)",
        None, 40, None,
        FLOOR + CUBE.format(0.1)
        + "p.changeDynamics(b, -1, contactStiffness=3000, contactDamping=1)\nsteps(100)",
    ),
    Case(
        "tunnelled", WALL + BULLET + "steps(8)", "1_box", 3, None,
        WALL + BULLET + "p.setTimeStep(1 / 4800)\nsteps(160)",
    ),
    Case(
        "energy-gained", FLOOR + CUBE.format(0.005) + "p.setTimeStep(1 / 1000)\nsteps(50)",
        "1_cube_small", 1, None,
        FLOOR + CUBE.format(0.005) + "p.setPhysicsEngineParameter(contactERP=0)\n"
        "p.setTimeStep(1 / 1000)\nsteps(50)",
    ),
    Case(
        "energy-gained", FLOOR + CUBE.format(0.005) + "p.setTimeStep(1 / 1000)\nsteps(50)",
        "1_cube_small", 1, None, FLOOR + CUBE.format(0.025) + "p.setTimeStep(1 / 1000)\nsteps(50)",
    ),
    Case(
        "energy-gained",
        FLOOR + CUBE.format(0.2)
        + "for one in (0, b): p.changeDynamics(one, -1, restitution=1.2)\nsteps(100)",
        "1_cube_small", 46, None,
        FLOOR + CUBE.format(0.2)
        + "for one in (0, b): p.changeDynamics(one, -1, restitution=0.9)\nsteps(100)",
    ),
    Case(  # what overlaps by millimetres before it bounces is pushed out as well
        "energy-gained", BOUNCE + "steps(100)", "1_cube_small", 47, None,
        BOUNCE + "p.setPhysicsEngineParameter(contactERP=0)\nsteps(100)",
    ),
    Case(
        "teleported",
        GRAVITY + CUBE.format(3) + "steps(20)\n"
        "p.resetBasePositionAndOrientation(ornObj=[0, 0, 0, 1], posObj=[1, 0, 3], bodyUniqueId=b)\n"
        "steps(5)",
        "0_cube_small", 20, 4,
        GRAVITY + CUBE.format(3)
        + "p.resetBasePositionAndOrientation(b, [1, 0, 3], [0, 0, 0, 1])\nsteps(25)",
    ),
    Case(
        "teleported",
        GRAVITY + CUBE.format(3) + "s = p.saveState()\nsteps(20)\np.restoreState(s)\nsteps(5)",
        "0_cube_small", 20, 5, GRAVITY + CUBE.format(3) + "s = p.saveState()\nsteps(25)",
    ),
    Case(
        "velocity-clamped",
        GRAVITY + CUBE.format(3) + "p.resetBaseVelocity(b, [0, 0, 0], [0, 0, 150])\nsteps(5)",
        "0_cube_small", 1, None,
        GRAVITY + 'b = p.loadURDF("cube_small.urdf", [0, 0, 3], useMaximalCoordinates=True)\n'
        "p.resetBaseVelocity(b, [0, 0, 0], [0, 0, 150])\nsteps(5)",
    ),
    Case(
        "motor-at-limit", ROBOT + DRIVEN.format(5) + "steps(30)", "0_model", 1, None,
        ROBOT + DRIVEN.format(5000) + "steps(30)",
    ),
    Case(
        "joint-beyond-limits",
        ROBOT + "p.resetJointState(r, 1, 3)\np.resetJointState(r, 2, 0)\nsteps(3)", "0_model", 3, 3,
        ROBOT + "p.resetJointState(r, 1, 2)\nsteps(3)",
    ),
    Case(
        "impossible-inertia", INERTIA.format("0.001, 0.001, 0.01"), "0_box", 0, 4,
        INERTIA.format("0.001, 0.001, 0.0015"),
    ),
    Case(
        "inertia-far-from-shape", INERTIA.format("1, 1, 1"), "0_box", 0, 4,
        INERTIA.format("0.001, 0.001, 0.001"),
    ),
    Case(
        "inertia-without-mass", RIGID + "p.changeDynamics(b, -1, localInertiaDiagonal=[1, 1, 1])\n"
        "steps(2)", "0_cube_small", 0, 2,
        RIGID + "p.changeDynamics(b, -1, mass=2, localInertiaDiagonal=[1, 1, 1])\nsteps(2)",
    ),
    Case("solver-stopped-early", PILE.format(3), None, 1, None, PILE.format(2000)),
    Case("mass-ratio", STACK.format(500), None, 12, None, STACK.format(50)),
    Case(
        "mass-ratio", STACK.format(500), None, 12, None,
        "p.setPhysicsEngineParameter(numSolverIterations=5000)\n" + STACK.format(500),
    ),
    Case(
        "real-time", WINDOW + "p.setRealTimeSimulation(1)\nimport time; time.sleep(0.1)", None,
        None, 5, WINDOW + "steps(20)",
    ),
    Case(
        "unseeded", "import random\nx = random.random()\n" + FLOOR + "steps(1)", None, None, 2,
        "import random\nrandom.seed(0)\nx = random.random()\n" + FLOOR + "steps(1)",
    ),
    Case(
        "timestep-changed", GRAVITY + CUBE.format(3) + "steps(9)\np.setTimeStep(0.01)\nsteps(9)",
        None, 9, 4, GRAVITY + CUBE.format(3) + "p.setTimeStep(0.01)\nsteps(18)",
    ),
    Case(
        "self-collision", CHAIN.format("p.URDF_USE_SELF_COLLISION"), "0_box", 0, None,
        CHAIN.format(0),
    ),
    Case(
        "starts-in-contact", FLOOR + CUBE.format(0.01) + "steps(5)", "1_cube_small", 0, None,
        FLOOR + CUBE.format(0.025) + "steps(5)",
    ),
    Case(
        "joints-not-explained", ROBOT + "steps(2)", None, None, None,
        GRAVITY + CUBE.format(1) + "steps(2)",
    ),
]  # fmt: skip

HARMLESS = {
    "a trap door that is gone": (
        "tunnelled", WALL + BULLET + "steps(1)\np.removeBody(wall)\nsteps(7)",
    ),
    "a wall that comes later": (
        "tunnelled", GRAVITY + BULLET + "steps(6)\n" + BOX.format("0", "0.005, 1, 1", "1, 0, 0.5")
        + "steps(2)",
    ),
    "a wall that is put elsewhere before the first step": (
        "tunnelled",
        WALL + BULLET + "p.applyExternalForce(b, -1, [0, 0, 0.1], [0, 0, 0], p.LINK_FRAME)\n"
        "p.resetBasePositionAndOrientation(wall, [1, 0, -9], [0, 0, 0, 1])\nsteps(8)",
    ),
    "a wall that stands elsewhere in the next scene": (
        "tunnelled",
        "for x in (9, 1):\n    p.resetSimulation()\n    " + GRAVITY
        + "    " + BOX.format("0", "0.005, 1, 1", "x, 0, 0.5") + "    "
        + BULLET.replace("\np.", "\n    p.") + "    steps(8 if x == 9 else 2)",
    ),
    "a picture of a ball": (
        "tunnelled",
        WALL + "b = p.createMultiBody(1, -1, p.createVisualShape(p.GEOM_SPHERE, radius=0.02), "
        "[0, 0, 0.5])\np.resetBaseVelocity(b, [90, 0, 0])\nsteps(8)",
    ),
    "a floor that is turned, and thinner than the box around it": (
        "tunnelled",
        GRAVITY + 'p.loadURDF("plane.urdf", [0, 0, 0], [0.5, 0, 0, 0.866])\n'
        + BOX.format("1", "0.1, 0.1, 0.1", "0, -60, 0")
        + "p.setTimeStep(2)\np.changeDynamics(b, -1, linearDamping=0)\n"
        "p.resetBaseVelocity(b, [0, 90, 0])\nsteps(1)",
    ),
    "a wall that is not to be met": (
        "tunnelled", WALL + BULLET + "p.setCollisionFilterPair(b, wall, -1, -1, 0)\nsteps(8)",
    ),
    "a picture of a wall": (
        "tunnelled",
        GRAVITY + "p.createMultiBody(0, -1, p.createVisualShape(p.GEOM_BOX, "
        "halfExtents=[0.005, 1, 1]), [1, 0, 0.5])\n" + BULLET + "steps(8)",
    ),
    "a wall that is turned, and its corner": (
        "tunnelled",
        GRAVITY + "p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.005, 0.3,"
        " 0.3]), basePosition=[0.6, 0, 0.5], baseOrientation=[0, 0, 0.15, 0.989])\n"
        + BOX.format("1", "0.02, 0.02, 0.02", "0, 0.27, 0.5")
        + "p.changeDynamics(b, -1, linearDamping=0)\np.resetBaseVelocity(b, [99, 0, 0])\nsteps(6)",
    ),
    "what flies above a wall, and has its centre of mass below": (
        "tunnelled", WALL + ABOVE.format("0, 0, 0.5"),
    ),
    "a dumbbell with a ball on each side of a post": (
        "tunnelled",
        WALL.replace("1, 1", "0.1, 1")
        + "c = p.createCollisionShapeArray(shapeTypes=[p.GEOM_SPHERE] * 2, radii=[0.1] * 2, "
        "collisionFramePositions=[[0, -0.5, 0], [0, 0.5, 0]])\n"
        "b = p.createMultiBody(1, c, -1, [0, 0, 0.5])\n"
        "p.resetBaseVelocity(b, [90, 0, 0])\nsteps(8)",
    ),
    "the inertia of a btMultiBody": (
        "inertia-without-mass",
        BOX.format("1", "1, 1, 1", "0, 0, 0")
        + "p.changeDynamics(b, -1, localInertiaDiagonal=[1, 1, 1])\nsteps(2)",
    ),
    "nothing to meet": ("timestep-too-long", GRAVITY + BULLET + "steps(5)"),
    "a base without shapes of a btRigidBody": (
        "timestep-too-long",
        FLOOR + 'p.loadURDF("husky/husky.urdf", [0, 0, 1], useMaximalCoordinates=True)\nsteps(99)',
    ),
    "no mass that passes through none": (
        "tunnelled",
        WALL + BULLET.replace("createMultiBody(1", "createMultiBody(0") + "steps(8)",
    ),
    "no mass to fall": (
        "no-gravity",
        BOX.format("0", "1, 1, 1", "0, 0, 0") + "p.resetBaseVelocity(b, [0, 0, 1])\nsteps(9)",
    ),
    "a mass that a constraint holds": (
        "no-gravity",
        BOX.format("1", "1, 1, 1", "0, 0, 0")
        + "p.createConstraint(b, -1, -1, -1, p.JOINT_FIXED, [0] * 3, [0] * 3, [0] * 3)\nsteps(9)",
    ),
    "no mass, and none to meet": (
        "timestep-too-long",
        WALL + BULLET.replace("createMultiBody(1", "createMultiBody(0") + "steps(5)",
    ),
    "nothing but a picture": (
        "timestep-too-long",
        GRAVITY + "p.createMultiBody(0, -1, p.createVisualShape(p.GEOM_SPHERE, radius=0.1))\n"
        + BULLET + "steps(5)",
    ),
    "what is to meet nothing": (
        "timestep-too-long",
        FLOOR + BULLET + "p.setCollisionFilterGroupMask(b, -1, 0, 0)\nsteps(5)",
    ),
    "a new scene": (
        "teleported",
        "for n in range(2):\n    p.resetSimulation()\n    " + GRAVITY + "    "
        + CUBE.format("3 + n") + "    steps(20)",
    ),
    "a new scene with another timestep": (
        "timestep-changed",
        "for n in range(2):\n    p.resetSimulation()\n    p.setTimeStep(0.01 / (1 + n))\n    "
        + GRAVITY + "    " + CUBE.format(3) + "    steps(20)",
    ),
    "substeps": (
        "teleported",
        FLOOR + CUBE.format(0.1) + "p.setPhysicsEngineParameter(numSubSteps=4)\nsteps(60)",
    ),
    "soft contact": (
        "teleported",
        FLOOR + CUBE.format(0.1)
        + "p.changeDynamics(b, -1, contactStiffness=900, contactDamping=9)\n"
        "p.setPhysicsEngineParameter(numSubSteps=4)\nsteps(60)",
    ),
    "gravity that is off on purpose": (
        "no-gravity", "p.setGravity(0, 0, 0)\n" + CUBE.format(3) + "steps(3)",
    ),
    "gravity of its own": (
        "no-gravity",
        CUBE.format(3)
        + "for i in range(3):\n    p.applyExternalForce(b, -1, [0, 0, -0.1 * 9.81], [0, 0, 0], "
        "p.LINK_FRAME)\n    steps(1)",
    ),
    "no damping by default": (
        "default-damping",
        GRAVITY + 'p.loadURDF("cube_small.urdf", [0, 0, 3], useMaximalCoordinates=True)\nsteps(80)',
    ),
    "damping that was asked for": (
        "default-damping",
        GRAVITY + CUBE.format(3) + "p.changeDynamics(b, -1, linearDamping=0.04)\nsteps(80)",
    ),
    "a bounce": (
        "energy-gained",
        FLOOR + CUBE.format(0.2)
        + "for one in (0, b): p.changeDynamics(one, -1, restitution=0.95)\nsteps(100)",
    ),
    "a hammer": (
        "energy-gained",
        FLOOR + BOX.format("1", "0.05, 0.05, 0.05", "0, 0, 0.05") + "a = b\n"
        + BOX.format("1", "0.05, 0.05, 0.05", "-0.2, 0, 0.05")
        + "p.resetBaseVelocity(b, [5, 0, 0])\nsteps(60)",
    ),
    "a rolling ball that is pushed": (
        "energy-gained",
        FLOOR + 'b = p.loadURDF("sphere_small.urdf", [0, 0, 0.03])\n'
        "p.changeDynamics(b, -1, rollingFriction=0.001)\nsteps(50)\nfor i in range(20):\n"
        "    p.applyExternalForce(b, -1, [3, 0, 0], [0, 0, 0], p.LINK_FRAME)\n    steps(1)",
    ),
    "an impact that takes all iterations": (
        "solver-stopped-early", FLOOR + CUBE.format(0.5) + "steps(120)",
    ),
    "a hundred times as heavy": ("mass-ratio", STACK.format(100)),
    "light on heavy, beside a stack that does not converge": (
        "mass-ratio",
        PILE.format(3) + BOX.format("5000", "0.5, 0.5, 0.5", "3, 0, 0.5")
        + BOX.format("1", "0.05, 0.05, 0.05", "3, 0, 1.05") + "steps(60)",
    ),
    "light on heavy": (
        "mass-ratio",
        FLOOR + BOX.format("5000", "0.5, 0.5, 0.5", "0, 0, 0.5")
        + BOX.format("1", "0.05, 0.05, 0.05", "0, 0, 1.05") + "steps(60)",
    ),
    "made heavy once it is elsewhere": (
        "mass-ratio",
        STACK.format(1) + "\np.resetBasePositionAndOrientation(b, [3, 0, 5], [0, 0, 0, 1])\n"
        "steps(2)\np.changeDynamics(b, -1, mass=1000)\nsteps(3)",
    ),
    "heavy, and beside it what was put inside something": (
        "mass-ratio",
        "p.setPhysicsEngineParameter(numSolverIterations=2000)\n" + STACK.format(150) + "\n"
        + "".join(BOX.format(1, "0.1, 0.1, 0.1", f"{at}, 0, 0.1") for at in (4, 4.05, 4.1))
        + "steps(60)",
    ),
    "heavy on the ground": (
        "mass-ratio", FLOOR + BOX.format("9999", "1, 1, 1", "0, 0, 1") + "steps(3)",
    ),
    "a motor that holds a velocity": (
        "motor-at-limit",
        ROBOT + "p.setJointMotorControl2(r, 1, p.VELOCITY_CONTROL, targetVelocity=9, force=1)\n"
        "steps(30)",
    ),
    "a motor of a robot that a reset has removed": (
        "motor-at-limit",
        f"{ROBOT}{DRIVEN.format(5)}steps(5)\np.resetSimulation()\n{ROBOT}"
        "p.resetJointState(r, 1, 1)\nsteps(30)",
    ),
    "a motor of a robot that is removed before a step": (
        "motor-at-limit",
        f"{ROBOT}steps(5)\n{DRIVEN.format(5)}p.removeBody(r)\n{ROBOT}"
        "p.resetJointState(r, 1, 1)\nsteps(30)",
    ),
    "limits that are given": (
        "joint-beyond-limits",
        f"{ROBOT}p.changeDynamics(r, 1, jointLowerLimit=-3, jointUpperLimit=3)\n"
        "p.resetJointState(r, 1, 2.5)\nsteps(3)",
    ),
    "limits that are given while it moves, the lower one by default": (
        "joint-beyond-limits",
        f"{ROBOT}steps(2)\np.changeDynamics(r, 1, jointUpperLimit=3)\n"
        "p.changeDynamics(r, 2, jointLowerLimit=0, jointUpperLimit=1)\n"
        "p.changeDynamics(r, 1, jointLowerLimit=4, jointUpperLimit=0)\n"
        "p.resetJointState(r, 1, 2.5)\nsteps(3)",
    ),
    "a continuous joint with limits that PyBullet reports, and does not enforce": (
        "joint-beyond-limits", HEAD + "steps(60)",
    ),
    "a continuous joint that comes back": (
        "joint-beyond-limits",
        HEAD + "steps(60)\np.setJointMotorControl2(r, 13, p.VELOCITY_CONTROL, targetVelocity=-3, "
        "force=100)\nsteps(30)",
    ),
    "limits that are switched off": (
        "joint-beyond-limits",
        f"{ROBOT}p.changeDynamics(r, 1, jointLimitForce=0)\np.resetJointState(r, 1, 3)\nsteps(3)",
    ),
    "a script that asks for real time without a window": (
        "real-time", FLOOR + CUBE.format(1) + "p.setRealTimeSimulation(1)\nsteps(3)",
    ),
    "a light foot on a heavy body": (
        "velocity-clamped",
        FLOOR + "c = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)\n"
        "a, b = (p.createMultiBody(m, c, -1, [0, 0, z]) for m, z in ((1, 0.2), (1000, 0.6)))\n"
        "p.createConstraint(b, -1, a, -1, p.JOINT_FIXED, [0, 0, 1], [0, 0, -0.2], [0, 0, 0.2])\n"
        "steps(60)",
    ),
    "a bounce after which the weight of a step makes up for more than it took": (
        "energy-gained", FLOOR + CUBE.format(0.2) + RESTITUTION.format(1) + "steps(60)",
    ),
    "in contact from the start, and changed later": (
        "deep-penetration",
        FLOOR + CUBE.format(0.01)
        + "steps(1)\np.changeDynamics(b, -1, lateralFriction=0.9)\nsteps(1)",
    ),
    "a bounce that gives less than the weight takes": (
        "energy-gained",
        GRAVITY + BOX.format("0", "3, 3, 0.01", "0, 0, -0.1")
        + "p.changeDynamics(b, -1, restitution=1.2)\np.setTimeStep(0.01)\n"
        "b = p.createMultiBody(1, p.createCollisionShape(p.GEOM_CAPSULE, radius=0.032, "
        "height=0.105), basePosition=[0, 0, 0.05])\n"
        "p.changeDynamics(b, -1, restitution=0.5)\nsteps(40)",
    ),
    "a URDF without collision shapes, and a floor": ("tunnelled", FLOOR_4_MM + SHAPELESS),
    "its inertia": ("inertia-far-from-shape", FLOOR_4_MM + SHAPELESS),
    "its way in a step": ("timestep-too-long", FLOOR_4_MM + SHAPELESS),
    "two that never move": (
        "starts-in-contact",
        'p.loadMJCF("mjcf/capsule.xml")\np.loadURDF("plane.urdf")\nsteps(5)',
    ),
    "half a millimetre": ("starts-in-contact", FLOOR + CUBE.format(0.0245) + "steps(3)"),
}  # fmt: skip
"""What looks like a finding, and is none."""

Analyzed = Callable[[str], ScriptAnalysis]


@pytest.fixture(scope="module")
def recorded_scene(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Recording]:
    """Return a function from a scene to its recording, made once."""
    folder, known = tmp_path_factory.mktemp("findings"), dict[str, Recording]()

    def call(scene: str) -> Recording:
        if scene not in known:
            known[scene] = scenes.record(scene, folder / f"{len(known)}.rrd")
        return known[scene]

    return call


@pytest.fixture(scope="module")
def analyzed(recorded_scene: Callable[[str], Recording]) -> Analyzed:
    """Return a function from a scene to what is said of it."""
    return lambda scene: analyze(recorded_scene(scene).seen)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.code)
def test_a_finding_says_what_when_and_where(analyzed: Analyzed, case: Case) -> None:
    analysis = analyzed(case.scene)
    finding = found(analysis, case.code)
    where = None if case.line is None else site(case.line)
    assert (finding.body, finding.step, finding.site) == (case.body, case.step, where)
    assert finding.body is None or finding.message.startswith(finding.body)
    assert where is None or finding.message.endswith(f"({where})")
    assert "law-mismatch" not in codes(analysis)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.code)
def test_a_finding_is_gone_where_its_advice_was_followed(analyzed: Analyzed, case: Case) -> None:
    remedied = codes(analyzed(case.remedied))
    assert case.code not in remedied
    assert "law-mismatch" not in remedied


@pytest.mark.parametrize("name", HARMLESS)
def test_what_only_looks_like_it_is_no_finding(analyzed: Analyzed, name: str) -> None:
    code, scene = HARMLESS[name]
    assert not {code, "law-mismatch"} & {*codes(analyzed(scene))}


@pytest.mark.parametrize(
    ("call", "meets"),
    [
        ("p.setCollisionFilterPair(b, other, -1, -1, 0)", True),
        ("p.setCollisionFilterGroupMask(other, -1, 0, 0)", True),
        ("p.setCollisionFilterPair(b, wall, -1, -1, 0)", False),
        ("p.setCollisionFilterPair(wall, bodyUniqueIdB=b, linkIndexA=-1, linkIndexB=-1, "
        "enableCollision=0)", False),
        ("p.setCollisionFilterGroupMask(bodyUniqueId=wall, linkIndexA=-1, collisionFilterGroup=0, "
        "collisionFilterMask=0)", False),
        ("p.setCollisionFilterGroupMask(b, -1, 0, 0)", False),
    ],
)  # fmt: skip
def test_what_is_not_to_be_met_is_not_passed(analyzed: Analyzed, call: str, meets: bool) -> None:
    other = "other = p.createMultiBody(0, -1, -1, [0, 0, 9])\n"
    said = codes(analyzed(f"{WALL}{BULLET}{other}{call}\nsteps(8)"))
    assert ("tunnelled" in said) == ("timestep-too-long" in said) == meets


@pytest.mark.parametrize(
    "rest",
    [
        "p.resetBasePositionAndOrientation(wall, [9, 0, 0], [0, 0, 0, 1])",
        "p.resetSimulation()\n" + GRAVITY + BOX.format("0", "0.005, 1, 1", "9, 0, 0") + BULLET,
    ],
)
def test_a_wall_stands_where_it_is_until_it_is_moved(analyzed: Analyzed, rest: str) -> None:
    moved = f"{WALL}{BULLET}steps(8)\n{rest}\nsteps(2)"
    assert found(analyzed(moved), "tunnelled").step == 3


def test_a_shape_passes_through_wherever_its_centre_of_mass_is(analyzed: Analyzed) -> None:
    assert found(analyzed(WALL + ABOVE.format("0, 0, -2.5")), "tunnelled").step == 3


def test_a_timestep_that_changes_all_the_time_is_one_finding(analyzed: Analyzed) -> None:
    scene = (
        GRAVITY + CUBE.format(3) + "for i in range(9):\n    p.setTimeStep(0.01 + i)\n    steps(1)"
    )
    finding = found(analyzed(scene), "timestep-changed")
    assert finding.step == 1
    assert "from 1/100 s to 101/100 s at step 1 (the first of 8 changes)" in finding.message


@pytest.mark.parametrize("target", ["", "targetPosition=1, ", "1, "])
def test_a_motor_without_a_target_may_be_a_brake(analyzed: Analyzed, target: str) -> None:
    drives = f"p.setJointMotorControl2(r, 1, p.POSITION_CONTROL, {target}force=1)\nsteps(40)"
    start = ROBOT + "p.resetJointState(r, 1, 0.5)\n"
    message = found(analyzed(start + drives), "motor-at-limit").message
    assert message.endswith("more force") == bool(target)


def test_a_mass_counts_while_it_touches(analyzed: Analyzed) -> None:
    lighter = STACK.format(500) + "\np.changeDynamics(b, -1, mass=1)\nsteps(3)"
    assert found(analyzed(lighter), "mass-ratio").step == 12


def test_a_motion_that_nothing_explains_is_a_mismatch(
    recorded_scene: Callable[[str], Recording],
) -> None:
    seen = recorded_scene(GRAVITY + CUBE.format(3) + "steps(80)").seen
    assert "law-mismatch" not in codes(analyze(seen))
    late = pl.col("step") >= 50
    altered = pl.when(late).then(pl.col("vx_m_s") + 1e-6).otherwise(pl.col("vx_m_s"))
    seen = otherwise(seen, bases=seen.bases.with_columns(vx_m_s=altered))
    finding = found(analyze(seen), "law-mismatch")
    assert (finding.body, finding.step) == ("0_cube_small", 50)


def test_a_velocity_is_held_by_a_step_and_not_where_it_is_told(analyzed: Analyzed) -> None:
    scene = GRAVITY + CUBE.format(3) + "steps(5)\n" + CUBE.format(9)
    scene += "p.resetBaseVelocity(b, [0, 0, 0], [0, 0, 150])\nsteps(5)"
    assert found(analyzed(scene), "velocity-clamped").step == 6


def test_contacts_at_no_distance_are_not_deep(
    recorded_scene: Callable[[str], Recording],
) -> None:
    """As of links that PyBullet does not show, whose memory it does not initialise."""
    seen = recorded_scene(f"{FLOOR}{CUBE.format(0.02)}steps(5)").seen
    nowhere = seen.contacts.with_columns(distance_m=pl.lit(-math.inf))
    assert {*codes(analyze(seen))} & {"starts-in-contact", "deep-penetration"}
    said = {*codes(analyze(otherwise(seen, contacts=nowhere)))}
    assert not said & {"starts-in-contact", "deep-penetration"}


def test_a_velocity_that_is_held_is_told_of_what_a_constraint_holds_too(analyzed: Analyzed) -> None:
    """Where the law does not tell: at the step at which a component is 100 to the bit."""
    scene = GRAVITY + CUBE.format(3) + "steps(9)\n" + (
        "p.createConstraint(b, -1, -1, -1, p.JOINT_POINT2POINT, [0, 0, 0], [0, 0, 0], [0, 0, 9])\n"
        "steps(9)"
    )  # fmt: skip
    assert found(analyzed(scene), "velocity-clamped").step == 10


def test_a_velocity_that_is_held_within_a_step_need_not_end_there(
    recorded_scene: Callable[[str], Recording],
) -> None:
    scene = (
        FLOOR + CUBE.format(0.025) + "p.applyExternalForce(b, -1, [0, 0, -4000], [0, 0, 0], 1)\n"
    )
    seen = recorded_scene(f"{scene}steps(1)").seen
    assert seen.states["vz_m_s"].abs().max() < 50  # type: ignore[operator]
    finding = found(analyze(seen), "velocity-clamped")
    assert finding.step == 1
    assert "within step 1" in finding.message


def test_what_damping_moves_is_what_is_gone_without(
    recorded_scene: Callable[[str], Recording],
) -> None:
    """In this fast flight a fifth more than the term of damping alone."""
    fast = GRAVITY + CUBE.format(9) + "p.setTimeStep(1 / 60)\np.resetBaseVelocity(b, [60, 0, 30])\n"
    with_it = recorded_scene(f"{fast}steps(6)").seen
    message = found(analyze(with_it), "default-damping").message
    ends_m = [with_it.states.select("x_m", "y_m", "z_m").row(-1)]
    without = recorded_scene(f"{fast}p.changeDynamics(b, -1, linearDamping=0)\nsteps(6)").seen
    ends_m.append(without.states.select("x_m", "y_m", "z_m").row(-1))
    moved_mm = math.dist(*ends_m) * 1e3
    assert f"is moved {moved_mm:.3g} mm by damping" in message


def test_every_finding_has_a_case() -> None:
    """Of those that the code can say."""
    folder = Path(scenes.__file__).parents[1] / "pipeline/drop_physics/analysis/script"
    text = "".join(path.read_text() for path in sorted(folder.glob("*_findings.py")))
    known = set(re.findall(r'e\.finding\(\s*"([a-z-]+)"', text))
    assert known == {case.code for case in CASES} | {"law-mismatch"}


def test_what_is_inside_another_is_not_always_pushed_out(analyzed: Analyzed) -> None:
    still = f"{FLOOR}{CUBE.format(0.01)}p.setPhysicsEngineParameter(contactERP=0)\nsteps(5)"
    message = found(analyzed(still), "starts-in-contact").message
    assert message.endswith(
        " mm inside 0_plane at its first step; place it higher, or farther away"
    )


@pytest.mark.parametrize(
    "changed", ["p.setTimeStep(1 / 1000)", "p.setPhysicsEngineParameter(1 / 1000)"]
)
def test_a_motor_keeps_the_impulse_of_the_timestep_that_it_was_set_in(
    analyzed: Analyzed, recorded_scene: Callable[[str], Recording], changed: str
) -> None:
    """So it may give 40 × 1000 / 240 N m."""
    robot = (
        GRAVITY + 'r = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)\n'
        "p.resetJointState(r, 1, 1)\n"
    )
    drive = "p.setJointMotorControl2(r, 1, p.POSITION_CONTROL, targetPosition=1, force=40)\n"
    later, before = (
        f"{robot}{drive}{changed}\nsteps(100)",
        f"{robot}{changed}\n{drive}steps(100)",
    )
    assert np.abs(recorded_scene(later).seen.joints[0].effort[1:, 1]).min() > 44
    assert "motor-at-limit" not in codes(analyzed(later))
    assert "motor-at-limit" in codes(analyzed(before))


def test_what_a_constraint_holds_is_not_to_be_loaded_otherwise(analyzed: Analyzed) -> None:
    """PyBullet has constraints between btMultiBodies, or between two btRigidBodies."""
    scene = CUBE.format(1) + "{}p.resetBaseVelocity(b, [0, 0, 0], [0, 0, 150])\nsteps(5)"
    held = (
        "p.createConstraint(b, -1, -1, -1, p.JOINT_POINT2POINT, [0, 0, 0], [0, 0, 0], [0, 0, 1])\n"
    )
    free, joined = (
        found(analyzed(scene.format(each)), "velocity-clamped").message for each in ("", held)
    )
    assert free.endswith("load it with useMaximalCoordinates=True")
    assert joined.endswith("keep it slower")


def test_what_a_constraint_pulls_together_sinks_no_less_in_smaller_steps(
    analyzed: Analyzed, recorded_scene: Callable[[str], Recording]
) -> None:
    pulled = """
p.setGravity(0, 0, -9.81)
drum = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.19, height=0.22)
block = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.07, 0.23, 0.29])
turned = p.getQuaternionFromEuler([0.72, 0.05, 2.61])
a = p.createMultiBody(0.1, drum, -1, [-0.42, 0.58, 2.36], turned)
b = p.createMultiBody(2.5, block, -1, [-0.48, 0.46, 1.09])
p.createConstraint(a, -1, b, -1, p.JOINT_POINT2POINT, [0, 0, 0], [0, 0, 0.2], [0, 0, -0.2])
p.setTimeStep(1 / {rate})
steps({rate} // 4)
"""
    said = [
        one.message
        for one in analyzed(pulled.format(rate=240)).findings
        if one.code == "deep-penetration"
    ]
    depths_m = [
        -recorded_scene(pulled.format(rate=rate)).seen.contacts["distance_m"].min()
        for rate in (240, 960)
    ]
    assert depths_m[1] > depths_m[0]
    assert said
    assert not any("smaller timestep" in one for one in said)


def test_what_no_iteration_settles_is_not_told_to_iterate_more(analyzed: Analyzed) -> None:
    """As of a robot that is loaded deep in a floor: 3200 iterations change nothing."""
    scene = GRAVITY + BOX.format("0", "5, 5, 0.05", "0, 0, -0.05") + (
        'p.loadURDF("r2d2.urdf", [0, 0, 0.231])\n'
        "p.setPhysicsEngineParameter(numSolverIterations={})\nsteps(64)"
    )  # fmt: skip
    for iterations in (50, 800):
        message = found(analyzed(scene.format(iterations)), "solver-stopped-early").message
        assert message.endswith("give way")
    message = found(analyzed(PILE.format(3)), "solver-stopped-early").message
    assert "numSolverIterations=12" in message


def test_what_was_put_inside_is_told_to_stand_outside(analyzed: Analyzed) -> None:
    placed, _, _, bounced = (one for one in CASES if one.code == "energy-gained")
    assert "place it outside" in found(analyzed(placed.scene), "energy-gained").message
    assert "place it outside" not in found(analyzed(bounced.scene), "energy-gained").message


def test_a_springy_contact_is_told_its_stiffness(analyzed: Analyzed) -> None:
    rigid, springy = (one for one in CASES if one.code == "deep-penetration")
    assert "contactStiffness" in found(analyzed(springy.scene), "deep-penetration").message
    assert "contactStiffness" not in found(analyzed(rigid.scene), "deep-penetration").message


@pytest.mark.parametrize("maximal", [False, True])
def test_a_restitution_and_a_stiffness_count_while_they_act(
    analyzed: Analyzed, maximal: bool
) -> None:
    """Of a btRigidBody both are known only from the calls that gave them."""
    scene = (
        GRAVITY
        + f"""p.loadURDF("plane.urdf", useMaximalCoordinates={maximal})
b = p.loadURDF("cube_small.urdf", [0, 0, 0.2], useMaximalCoordinates={maximal})
"""
    )
    bouncy, dull = RESTITUTION.format(1.2), RESTITUTION.format(0)
    gained = found(analyzed(f"{scene}{bouncy}steps(60)\n{dull}steps(1)"), "energy-gained")
    assert "restitutions multiply to more than 1" in gained.message
    soft = "p.changeDynamics(b, -1, contactStiffness=30, contactDamping=1)\n"
    hard = "p.changeDynamics(b, -1, contactStiffness=-1, contactDamping=-1)\n"
    deep = found(analyzed(f"{scene}{soft}steps(60)\n{hard}steps(1)"), "deep-penetration")
    assert "contactStiffness" in deep.message


def test_a_restitution_and_a_stiffness_that_do_not_act_explain_nothing(analyzed: Analyzed) -> None:
    later = f"{BOUNCE}steps(60)\n{RESTITUTION.format(1.3)}steps(1)"
    assert "contactERP" in found(analyzed(later), "energy-gained").message
    slow = f"{FLOOR}{CUBE.format(0.005)}{RESTITUTION.format(1.3)}p.setTimeStep(1 / 1000)\nsteps(50)"
    assert "contactERP" in found(analyzed(slow), "energy-gained").message
    soft = "p.changeDynamics(b, -1, contactStiffness=30, contactDamping=1)\n"
    later = f"{FLOOR}{CUBE.format(1)}steps(150)\np.resetBaseVelocity(b, [0, 0, 5])\n{soft}steps(1)"
    assert "contactStiffness" not in found(analyzed(later), "deep-penetration").message


def test_limits_count_in_the_steps_in_which_they_hold(analyzed: Analyzed) -> None:
    """Given by `changeDynamics`, and gone with the robot."""
    narrow = "p.changeDynamics(r, 1, jointLowerLimit=-1, jointUpperLimit=1)\n"
    put = "p.resetJointState(r, 1, 1.5)\nsteps(2)\n"
    finding = found(analyzed(f"{ROBOT}{put}{narrow}steps(2)"), "joint-beyond-limits")
    assert finding.step == 4
    assert "limits are -1 and 1:" in finding.message
    again = f"{ROBOT}{narrow}steps(2)\np.resetSimulation()\n{ROBOT}{put}"
    assert "joint-beyond-limits" not in codes(analyzed(again))


def test_limits_are_enforced_unless_a_joint_moves_far_beyond_them(analyzed: Analyzed) -> None:
    """And those that a call gives, even of a continuous joint."""
    given = "p.changeDynamics(r, 13, jointLowerLimit=-1, jointUpperLimit=1)\n"
    finding = found(analyzed(f"{HEAD}steps(120)\n{given}steps(9)"), "joint-beyond-limits")
    assert "limits are -1 and 1:" in finding.message
    reset = f"{ROBOT}for i in range(30):\n    p.resetJointState(r, 1, 2.2 + i / 50)\n    steps(1)"
    assert "joint-beyond-limits" in codes(analyzed(reset))
    creeping = f"{ROBOT}p.resetJointState(r, 1, 3)\nsteps(60)"
    assert "joint-beyond-limits" in codes(analyzed(creeping))


def test_limits_are_on_again_with_a_force(analyzed: Analyzed) -> None:
    off, on = (f"p.changeDynamics(r, 1, jointLimitForce={force})\n" for force in (0, 1e6))
    scene = f"{ROBOT}{off}p.resetJointState(r, 1, 3)\nsteps(9)\n{on}steps(2)"
    assert "joint-beyond-limits" in codes(analyzed(scene))


def test_a_motor_that_is_set_again_drives_the_robot_that_is_loaded_again(
    analyzed: Analyzed,
) -> None:
    scene = (
        f"{ROBOT}{DRIVEN.format(5)}steps(5)\np.removeBody(r)\n{ROBOT}{DRIVEN.format(5)}steps(30)"
    )
    assert found(analyzed(scene), "motor-at-limit").step == 6


FINGERS = (
    """s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.1, 0.1])
r = p.createMultiBody(0, -1, basePosition=[0, 0, 1], linkMasses=[1, 1],
    linkCollisionShapeIndices=[s] * 2, linkVisualShapeIndices=[-1] * 2,
    linkPositions=[[0, 0, 0], [0, 1, 0]], linkOrientations=[[0, 0, 0, 1]] * 2,
    linkInertialFramePositions=[[0, 0, 0]] * 2,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2, linkParentIndices=[0, 0],
    linkJointTypes=[p.JOINT_PRISMATIC] * 2, linkJointAxis=[[1, 0, 0]] * 2)
"""
    + BOX.format("0", "0.1, 0.1, 0.1", "0.3, 0, 1")
    + "p.setJointMotorControl2(r, 0, p.POSITION_CONTROL, targetPosition=0.5, force=20)\n"
)  # fmt: skip


def test_more_force_is_no_advice_where_a_contact_holds_a_joint(analyzed: Analyzed) -> None:
    """A finger at a fixed box; another one, that nothing touches, lags behind for less long."""
    message = found(analyzed(f"{FINGERS}steps(200)"), "motor-at-limit").message
    assert message.endswith("may lag behind its target")
    free = "p.setJointMotorControl2(r, 1, p.POSITION_CONTROL, targetPosition=50, force=0.02)\n"
    finding = found(analyzed(f"{FINGERS}steps(150)\n{free}steps(50)"), "motor-at-limit")
    assert finding.step == 151
    assert finding.message.endswith("more force")


def test_more_force_is_no_advice_where_a_constraint_holds_a_joint(analyzed: Analyzed) -> None:
    held = FINGERS.replace("0.3, 0, 1", "9, 0, 1") + (
        "p.createConstraint(r, 0, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 1])\n"
    )
    message = found(analyzed(f"{held}steps(100)"), "motor-at-limit").message
    assert message.endswith("may lag behind its target")


def test_more_force_is_no_advice_where_a_velocity_limit_holds_a_joint(analyzed: Analyzed) -> None:
    slow = FINGERS.replace("0.3, 0, 1", "9, 0, 1") + "p.changeDynamics(r, 0, maxJointVelocity=.1)\n"
    message = found(analyzed(f"{slow}steps(200)"), "motor-at-limit").message
    assert message.endswith("may lag behind its target")


def test_an_inertia_that_was_given_is_gone_with_its_body(
    analyzed: Analyzed, tmp_path: Path
) -> None:
    """The file of the cube that is loaded again says so, no call does."""
    file = tmp_path / "cube.urdf"
    file.write_text(
        '<robot name="cube"><link name="base"><inertial><mass value="1"/><inertia ixx="1" ixy="0" '
        'ixz="0" iyy="1" iyz="0" izz="1"/></inertial><collision><geometry><box size="0.1 0.1 0.1"/>'
        "</geometry></collision></link></robot>"
    )
    load = f'{GRAVITY}b = p.loadURDF("{file}", [0, 0, 1], flags=p.URDF_USE_INERTIA_FROM_FILE)\n'
    given = "p.changeDynamics(b, -1, localInertiaDiagonal=[0.001, 0.001, 0.001])\n"
    scene = f"{load}{given}steps(2)\np.resetSimulation()\n{load}steps(2)"
    finding = found(analyzed(scene), "inertia-far-from-shape")
    assert finding.site is None
    assert "if a file gives it" in finding.message


def test_a_body_moves_in_substeps(analyzed: Analyzed) -> None:
    """In each of which the engine looks for contact."""
    _, case = (one for one in CASES if one.code == "timestep-too-long")
    message = found(analyzed(case.scene), "timestep-too-long").message
    assert " in a substep of 1/960 s at" in message


THIN = FLOOR + (
    "c = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.003])\n"
    "turned = p.getQuaternionFromEuler([0.4, 0.3, 0.2])\n"
)
FAST = "p.resetBaseVelocity(b, [9, 0, 0])\nsteps(1)\n"


@pytest.mark.parametrize(
    ("turned", "drawn", "thick_mm"),
    [
        ("turned", "-1", "6"),  # PyBullet draws what it collides with
        ("[0, 0, 0, 1]", "p.createVisualShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.001])", "6"),
        ("[0.5, 0.5, 0.5, 0.5]", "p.createVisualShape(p.GEOM_SPHERE, radius=0.1)", "6"),
        ("turned", "p.createVisualShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.001])", None),
    ],
)
def test_a_body_is_as_thick_as_its_own_shape(
    analyzed: Analyzed, turned: str, drawn: str, thick_mm: str | None
) -> None:
    scene = f"{THIN}b = p.createMultiBody(1, c, {drawn}, [0, 0, 1], {turned})\n{FAST}"
    findings = {each.code: each.message for each in analyzed(scene).findings}
    assert ("timestep-too-long" in findings) == (thick_mm is not None)
    assert thick_mm is None or f" {thick_mm} mm thick" in findings["timestep-too-long"]


@pytest.mark.parametrize("turned", [False, True])
def test_a_turned_mesh_has_no_known_thickness(analyzed: Analyzed, turned: bool) -> None:
    orientation = "p.getQuaternionFromEuler([0.4, 0.3, 0.2])" if turned else "[0, 0, 0, 1]"
    scene = f'{FLOOR}b = p.loadURDF("cube_small.urdf", [0, 0, 1], {orientation})\n{FAST}'
    fast = scene.replace("[9, 0, 0]", "[30, 0, 0]")
    assert ("timestep-too-long" in codes(analyzed(fast))) != turned


def test_a_body_that_is_loaded_again_has_a_thickness_of_its_own(analyzed: Analyzed) -> None:
    """The same id, name and make-up after a reset are the same body."""
    thin = f"{THIN}b = p.createMultiBody(1, c, -1, [0, 0, 1])\n"
    thick = thin.replace("0.003", "0.1")
    scene = f"{thin}{FAST}p.resetSimulation()\n{thick}steps(9)"
    assert found(analyzed(scene), "timestep-too-long").step == 1
    scene = f"{thick}{FAST}p.resetSimulation()\n{thin}steps(9)"
    assert "timestep-too-long" not in codes(analyzed(scene))


INSIDE = FLOOR + CUBE.format(0.005)
SOFT = "p.changeDynamics(b, -1, contactStiffness={}, contactDamping=1)\n"
BESIDE = (
    GRAVITY + BOX.format("0", "0.05, 0.05, 0.2", "0, 0, 0.2")
    + BOX.format("1", "0.025, 0.025, 0.025", "0.069, 0, 0.5")
    + "p.resetBaseVelocity(b, [0, 0, -20])\n"
)  # fmt: skip
CAUSES = {
    "a spring, and what was put into it": (
        "energy-gained", INSIDE + SOFT.format(1000) + "steps(9)", "place it outside",
    ),
    "the overlap, not a restitution that nothing is fast enough for": (
        "energy-gained", INSIDE + RESTITUTION.format(1.2) + "steps(9)", "(contactERP=0)",
    ),
    "restitution, not what is overlapped in a step": (
        "energy-gained", FLOOR + CUBE.format(0.2) + RESTITUTION.format(1.2) + "steps(60)",
        "lower one of them",
    ),
    "restitution, and more of it what is overlapped in a step": (
        "energy-gained", FLOOR + CUBE.format(1) + RESTITUTION.format(1.001) + "steps(130)",
        "lower one of them, and call p.setPhysicsEngineParameter(contactERP=0)",
    ),
    "neither where a spring may have given it too": (
        "energy-gained",
        FLOOR + CUBE.format(0.2) + RESTITUTION.format(1.2)
        + "p.changeDynamics(b, -1, contactStiffness=100, contactDamping=50)\nsteps(60)",
        "nothing pushed it",
    ),
    "neither where friction gave it, by restitution in an oblique impact": (
        "energy-gained",
        FLOOR + """
s = p.createCollisionShape(p.GEOM_CYLINDER, radius=.185, height=.1)
b = p.createMultiBody(200, s, -1, [.300052, .210932, .154139],
                      [-.19522, -.225573, .639398, .708644])
p.changeDynamics(0, -1, restitution=.78)
p.changeDynamics(b, -1, restitution=1.127, lateralFriction=.756, linearDamping=0,
                 angularDamping=0, localInertiaDiagonal=[2.00836592, 2.00836592, 3.44214134])
p.resetBaseVelocity(b, [1.660677, .661586, -3.3173], [-.528449, -.821609, 4.693427])
steps(12)
""",
        "nothing pushed it",
    ),
    "the approach, whatever the spring": (
        "deep-penetration",
        FLOOR + CUBE.format(0.3) + "p.setTimeStep(0.01)\n" + SOFT.format(9) + "steps(25)",
        "detected only once they overlap",
    ),
    "none where they meet at an edge": ("deep-penetration", BESIDE + "steps(9)", "thinner one"),
    "no spring that has not been compressed": (
        "deep-penetration", BESIDE + SOFT.format(1000) + "steps(9)", "thinner one",
    ),
}  # fmt: skip
"""What a finding ends with: a cause, advice, or neither."""


@pytest.mark.parametrize("name", CAUSES)
def test_a_cause_is_named_where_what_was_recorded_implies_it(analyzed: Analyzed, name: str) -> None:
    code, scene, ending = CAUSES[name]
    message = found(analyzed(scene), code).message
    assert message.endswith(ending)

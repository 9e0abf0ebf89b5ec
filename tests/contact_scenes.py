"""Scenes of touching bodies, and their outcome in bare PyBullet."""

from __future__ import annotations

from typing import Any

import pybullet as p
from clients import release_clients
from scenes import HEAD

FLOOR = "p.setGravity(0, 0, -9.81)\np.loadURDF('plane.urdf')\n"
BOX = """
def box(mass, at, half=(0.05, 0.05, 0.05), mu=0.5, turned=(0, 0, 0)):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half)
    made = p.createMultiBody(mass, shape, -1, at, p.getQuaternionFromEuler(turned))
    p.changeDynamics(made, -1, lateralFriction=mu)
    return made
def ball(mass, at, radius=0.1):
    return p.createMultiBody(mass, p.createCollisionShape(p.GEOM_SPHERE, radius=radius), -1, at)
def joined(shapes, places, axes, parents, masses=None):
    n = len(shapes)
    return p.createMultiBody(
        0, -1, -1, [0, 0, 0], [0, 0, 0, 1], linkMasses=masses or [1.0] * n,
        linkCollisionShapeIndices=shapes, linkVisualShapeIndices=[-1] * n, linkPositions=places,
        linkOrientations=[[0, 0, 0, 1]] * n, linkInertialFramePositions=[[0, 0, 0]] * n,
        linkInertialFrameOrientations=[[0, 0, 0, 1]] * n, linkParentIndices=parents,
        linkJointTypes=[p.JOINT_PRISMATIC] * n, linkJointAxis=axes)
def shape(*half):
    return p.createCollisionShape(p.GEOM_BOX, halfExtents=half)
"""
SLOPE = (
    BOX
    + """
import math
a = math.radians({degrees})
p.setGravity(9.81 * math.sin(a), 0, -9.81 * math.cos(a))
f = p.loadURDF("plane.urdf")
b = box(1, [0, 0, 0.05 + {above}], mu={mu})
steps({steps})
"""
)
GRIP = (
    BOX
    + """
p.setPhysicsEngineParameter(numSolverIterations=200)
g = joined([shape(.01, .01, .01)] * 2, [[0, -.035, 1], [0, .035, 1]], [[0, 1, 0], [0, -1, 0]],
    [0, 0])
b = box({mass}, [{off}, 0, 1], (.3, .02, .02), mu={mu})
for j in (0, 1):
    p.changeDynamics(g, j, lateralFriction=1)
    p.setJointMotorControl2(g, j, p.VELOCITY_CONTROL, targetVelocity=.1, force={force})
steps(120)
p.setGravity(0, 0, -9.81)
steps(240)
"""
)
LIFT = (
    FLOOR
    + BOX
    + """
g = joined([-1] + [shape(.01, .01, .01)] * 2, [[0, 0, .05], [0, -.07, 0], [0, .07, 0]],
    [[0, 0, 1], [0, 1, 0], [0, -1, 0]], [0, 1, 1])
b = box({mass}, [0, 0, .05], mu={mu})
for j in (1, 2):
    p.changeDynamics(g, j, lateralFriction=1)
for i in range(480):
    for j in (1, 2):
        p.setJointMotorControl2(g, j, p.VELOCITY_CONTROL, targetVelocity=.1,
            force={force} if i < 400 else 0)
    p.setJointMotorControl2(g, 0, p.POSITION_CONTROL, 0 if i < 120 else min((i - 120) / 1200, .2),
        force=500)
    p.stepSimulation()
"""
)
PUSHED = (
    FLOOR
    + BOX
    + """
k = joined([p.createCollisionShape(p.GEOM_SPHERE, radius=.04)], [[-.3, 0, .05]], [[1, 0, 0]], [0])
b = box(1, [0, 0, .05])
for i in range(480):
    p.setJointMotorControl2(k, 0, p.POSITION_CONTROL, min(i / 480, 1) * .6, force=200)
    p.stepSimulation()
"""
)
PUCK = (
    FLOOR
    + BOX
    + """
b = box(1, [0, 0, .05])
steps(120)
p.resetBaseVelocity(b, [2, 0, 0])
steps(240)
"""
)
PANDA = (
    FLOOR
    + """
r = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
for j, q in zip([*range(7), 9, 10], [0, .3, 0, -2.2, 0, 2.5, .8, .04, .04]):
    p.resetJointState(r, j, q)
    p.setJointMotorControl2(r, j, p.POSITION_CONTROL, q, force=200)
s = p.getLinkState(r, 11)
b = p.loadURDF("cube_small.urdf", s[0], s[1])
for j in (9, 10):
    p.setJointMotorControl2(r, j, p.POSITION_CONTROL, 0.0, force=20)
steps(300)
"""
)
HEIGHT = "z = []\nfor i in range(240):\n    p.stepSimulation()\n" + (
    "    z.append(p.getBasePositionAndOrientation(b)[0][2])\n"
)
STACK = FLOOR + BOX + "for k in range(5):\n    b = box(1, [0, 0, .05 + .1 * k])\nsteps(60)"


def bare(scene: str) -> dict[str, Any]:
    """Run a scene without a recorder; return its variables, and body b's end position `where`."""
    names: dict[str, Any] = {}
    release_clients()
    exec(HEAD + scene, names)
    names["where"], _ = p.getBasePositionAndOrientation(names["b"])
    names["velocity"], _ = p.getBaseVelocity(names["b"])
    p.disconnect()
    return names

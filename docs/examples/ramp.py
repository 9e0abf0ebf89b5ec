"""A crate on a ramp that holds it, and creeps all the same."""

import math

import pybullet as p

p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
tilt = p.getQuaternionFromEuler([0, math.radians(20), 0])
ramp = p.createMultiBody(
    0,
    p.createCollisionShape(p.GEOM_BOX, halfExtents=[2, 1, 0.1]),
    baseOrientation=tilt,
)
crate = p.createMultiBody(
    1,
    p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3),
    basePosition=p.rotateVector(tilt, [0, 0, 0.2]),
    baseOrientation=tilt,
)
p.changeDynamics(ramp, -1, lateralFriction=1)
p.changeDynamics(crate, -1, lateralFriction=0.5)
for _ in range(480):
    p.stepSimulation()

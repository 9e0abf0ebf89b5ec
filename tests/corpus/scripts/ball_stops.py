"""I roll a ball over a level floor at 2 m/s, and it stops after 0.3 m."""

import sys

import pybullet as p

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
floor = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
ball = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), -1, [0, 0, 0.1])
p.changeDynamics(ball, -1, lateralFriction=1, linearDamping=0, angularDamping=0)
p.changeDynamics(floor, -1, lateralFriction=1)
if not FIX:
    p.changeDynamics(ball, -1, rollingFriction=0.05)
    p.changeDynamics(floor, -1, rollingFriction=0.05)
p.resetBaseVelocity(ball, [2, 0, 0], [0, 20, 0])
for _ in range(480):
    p.stepSimulation()
print("ball at", p.getBasePositionAndOrientation(ball)[0][0])

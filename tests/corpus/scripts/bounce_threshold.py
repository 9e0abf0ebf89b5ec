"""My ball and the floor have restitution 0.95, and it does not bounce."""

import sys

import pybullet as p

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
p.setPhysicsEngineParameter(restitutionVelocityThreshold=0.2 if FIX else 5)
floor = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
ball = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), -1, [0, 0, 1])
for body in (floor, ball):
    p.changeDynamics(body, -1, restitution=0.95)
top = 0.0
for i in range(480):
    p.stepSimulation()
    if i > 120:
        top = max(top, p.getBasePositionAndOrientation(ball)[0][2])
print("apex", top)

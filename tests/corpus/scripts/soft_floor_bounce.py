"""My ball has restitution 0.95 on a floor with 0.95, and hardly bounces."""

import sys

import pybullet as p

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
floor = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
ball = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), -1, [0, 0, 1])
for body in (floor, ball):
    p.changeDynamics(body, -1, restitution=0.95)
if not FIX:
    p.changeDynamics(floor, -1, contactStiffness=5000, contactDamping=500)
top = 0.0
for i in range(480):
    p.stepSimulation()
    if i > 120:
        top = max(top, p.getBasePositionAndOrientation(ball)[0][2])
print("apex", top)

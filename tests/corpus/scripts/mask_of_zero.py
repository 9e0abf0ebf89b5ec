"""My crate falls through the floor."""

import sys

import pybullet as p

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
crate = p.createMultiBody(
    1, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1]), -1, [0, 0, 0.5]
)
if not FIX:
    p.setCollisionFilterGroupMask(crate, -1, 0, 0)
for _ in range(240):
    p.stepSimulation()
print("crate at", p.getBasePositionAndOrientation(crate)[0][2])

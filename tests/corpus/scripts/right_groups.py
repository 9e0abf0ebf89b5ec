"""Two teams of boxes pass through each other, as they are to."""

import pybullet as p

p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
half = [0.1, 0.1, 0.1]
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=half)
floor = p.createCollisionShape(p.GEOM_BOX, halfExtents=[2, 2, 0.1])
p.createMultiBody(0, floor, basePosition=[0, 0, -0.1])
left = p.createMultiBody(1, box, basePosition=[-1, 0, 0.1])
right = p.createMultiBody(1, box, basePosition=[1, 0, 0.1])
# Each meets the floor (group 2 of what does not move) and its own team.
p.setCollisionFilterGroupMask(left, -1, 4, 4 | 2)
p.setCollisionFilterGroupMask(right, -1, 8, 8 | 2)
for body in (left, right):
    p.changeDynamics(body, -1, lateralFriction=0, linearDamping=0, angularDamping=0)
p.resetBaseVelocity(left, [1, 0, 0])
p.resetBaseVelocity(right, [-1, 0, 0])
for _ in range(480):
    p.stepSimulation()
print("left", p.getBasePositionAndOrientation(left)[0], "right", p.getBasePositionAndOrientation(right)[0])

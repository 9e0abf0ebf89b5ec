"""A rope that gives."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
hook = p.createMultiBody(0, box, basePosition=[0, 0, 1])
load = p.createMultiBody(5, box, basePosition=[0, 0, 0.7])
rope = p.createConstraint(
    hook, -1, load, -1, p.JOINT_POINT2POINT, [0, 0, 0], [0, 0, -0.3], [0, 0, 0]
)
p.changeConstraint(rope, maxForce=30)
for _ in range(240):
    p.stepSimulation()

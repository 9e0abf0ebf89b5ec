"""A heavy block on a light one."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
p.createMultiBody(1, box, basePosition=[0, 0, 0.1])
p.createMultiBody(1000, box, basePosition=[0, 0, 0.301])
for _ in range(480):
    p.stepSimulation()

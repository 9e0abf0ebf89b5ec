"""A crate that is only to be seen: it has a visual shape, and nothing that collides."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
crate = p.createVisualShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
p.createMultiBody(baseMass=1, baseVisualShapeIndex=crate, basePosition=[0, 0, 1])
for _ in range(240):
    p.stepSimulation()

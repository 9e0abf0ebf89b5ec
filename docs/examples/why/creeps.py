"""A crate that should hold on its slope."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.setPhysicsEngineParameter(solverResidualThreshold=1e-3)
p.setGravity(3.36, 0, -9.22)
floor = p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[5, 5, 0.5]))
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.05])
crate = p.createMultiBody(1, shape, basePosition=[0, 0, 0.55])
p.changeDynamics(floor, -1, lateralFriction=1)
p.changeDynamics(crate, -1, lateralFriction=0.9)
for _ in range(1200):
    p.stepSimulation()

"""A box that stays behind its platform."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
platform = p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[1, 1, 0.05]))
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
box = p.createMultiBody(1, shape, basePosition=[0, 0, 0.15])
for step in range(240):
    p.resetBasePositionAndOrientation(platform, [0.5 * step / 240, 0, 0], [0, 0, 0, 1])
    p.stepSimulation()

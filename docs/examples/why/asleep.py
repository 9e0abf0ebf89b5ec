"""A push that does nothing."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
cube = p.loadURDF("cube_small.urdf", [0, 0, 0.025], flags=p.URDF_ENABLE_SLEEPING)
for _ in range(800):
    p.stepSimulation()
for _ in range(60):
    p.applyExternalForce(cube, -1, [1.5, 0, 0], [0, 0, 0], p.LINK_FRAME)
    p.stepSimulation()

"""A robot that is too heavy."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
p.loadURDF("husky/husky.urdf", [0, 0, 0.14])
for _ in range(240):
    p.stepSimulation()

"""A heap of cubes."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
for n in range(8):
    p.loadURDF("cube_small.urdf", [0.01 * n, 0.007 * n, 0.1 + 0.07 * n])
for _ in range(240):
    p.stepSimulation()

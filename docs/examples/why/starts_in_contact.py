"""Two cubes in one place."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
p.loadURDF("cube_small.urdf", [0, 0, 0.025])
p.loadURDF("cube_small.urdf", [0.01, 0, 0.03])
for _ in range(240):
    p.stepSimulation()

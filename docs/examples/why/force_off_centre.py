"""A lift that makes its body whirl."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
cube = p.loadURDF("cube_small.urdf", [2, 0, 1])
for _ in range(120):
    p.applyExternalForce(cube, -1, [0, 0, 0.981], [0, 0, 0], p.WORLD_FRAME)
    p.stepSimulation()

"""A drone that sinks."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
drone = p.loadURDF("cube_small.urdf", [0, 0, 1])
for _ in range(60):
    p.applyExternalForce(drone, -1, [0, 0, 0.1 * 9.81], [0, 0, 0], p.LINK_FRAME)
    for _ in range(4):
        p.stepSimulation()

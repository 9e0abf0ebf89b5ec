"""Drop a box for 0.3 s, and ask why it is not where free fall would take it."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
box = p.loadURDF("cube_small.urdf", [0, 0, 1])
p.changeDynamics(box, -1, lateralFriction=0.9)
for _ in range(72):
    p.stepSimulation()

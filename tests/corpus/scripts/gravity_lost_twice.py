"""From the second episode on, my cube floats."""

import sys

import pybullet as p
import pybullet_data

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
for _ in range(3):
    cube = p.loadURDF("cube_small.urdf", [0, 0, 0.4])
    for _ in range(60):
        p.stepSimulation()
    print("height:", p.getBasePositionAndOrientation(cube)[0][2])
    p.resetSimulation()
    if FIX:
        p.setGravity(0, 0, -9.81)

"""The front wheels of my robot turn at 1.8 m/s, and it goes at 0.6 m/s."""

import sys

import pybullet as p
import pybullet_data

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
husky = p.loadURDF("husky/husky.urdf", [0, 0, 0.15])
for _ in range(480):
    for wheel, speed in ((2, 10), (3, 10), (4, 10 if FIX else 3), (5, 10 if FIX else 3)):
        p.setJointMotorControl2(husky, wheel, p.VELOCITY_CONTROL, targetVelocity=speed, force=100)
    p.stepSimulation()
print("robot at", p.getBasePositionAndOrientation(husky)[0][0])

"""The robot hangs in the air: its legs walk, and it goes nowhere."""

import math
import sys

import pybullet as p
import pybullet_data

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
robot = p.loadURDF("a1/a1.urdf", [0, 0, 0.42], useFixedBase=not FIX)
joints = [j for j in range(p.getNumJoints(robot)) if p.getJointInfo(robot, j)[2] == p.JOINT_REVOLUTE]
for i in range(960):
    for k, j in enumerate(joints):
        phase = 2 * math.pi * i / 120 + (math.pi if k // 3 in (1, 2) else 0)
        target = [0, 0.8 - 0.2 * math.cos(phase), -1.5 + 0.25 * max(0, math.sin(phase))][k % 3]
        p.setJointMotorControl2(robot, j, p.POSITION_CONTROL, target, force=30)
    p.stepSimulation()
print("body", [round(x, 3) for x in p.getBasePositionAndOrientation(robot)[0]])

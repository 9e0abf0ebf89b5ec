"""The robot jumps under torque control, and then it is gone."""

import math
import sys

import pybullet as p
import pybullet_data

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
plane = p.loadURDF("plane.urdf")
robot = p.loadURDF("a1/a1.urdf", [0, 0, 0.32])
joints = [j for j in range(p.getNumJoints(robot)) if p.getJointInfo(robot, j)[2] == p.JOINT_REVOLUTE]
pose = [0, 0.8, -1.5] * 4
for j, q in zip(joints, pose):
    p.resetJointState(robot, j, q)
    p.setJointMotorControl2(robot, j, p.VELOCITY_CONTROL, force=0)
kp, kd = (60, 0.6) if FIX else (300, 30)
worst = 0.0
for i in range(480):
    for j, q in zip(joints, pose):
        angle, rate = p.getJointState(robot, j)[:2]
        p.setJointMotorControl2(robot, j, p.TORQUE_CONTROL, force=kp * (q - angle) - kd * rate)
    p.stepSimulation()
    for c in p.getContactPoints(robot, plane):
        worst = max(worst, c[9]) if math.isfinite(c[9]) else float("inf")
print("greatest force", worst, "height", p.getBasePositionAndOrientation(robot)[0][2])

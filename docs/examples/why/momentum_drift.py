"""A robot that drifts in empty space."""

import math

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.setGravity(0, 0, 0)
arm = p.loadURDF("kuka_iiwa/model_free_base.urdf")
for step in range(480):
    for joint in range(7):
        angle = 0.8 * math.sin(0.03 * step + joint)
        p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, angle, force=100)
    p.stepSimulation()

"""Gains as of a PD controller."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for joint in range(7):
    p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, 0.2, positionGain=2000, velocityGain=50)
for _ in range(240):
    p.stepSimulation()

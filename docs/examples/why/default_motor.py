"""Torques that move nothing."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for _ in range(240):
    p.setJointMotorControl2(arm, 0, p.TORQUE_CONTROL, force=4.8)
    p.stepSimulation()

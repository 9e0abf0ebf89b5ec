"""A robot that shakes."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for joint in range(7):
    p.setJointMotorControl2(arm, joint, p.VELOCITY_CONTROL, force=0)
for _ in range(240):
    p.stepSimulation()

"""A torque that turns an arm less than it should."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for joint in range(7):
    p.setJointMotorControl2(arm, joint, p.VELOCITY_CONTROL, force=500 if joint else 0)
for _ in range(120):
    p.setJointMotorControl2(arm, 0, p.TORQUE_CONTROL, force=3)
    p.stepSimulation()

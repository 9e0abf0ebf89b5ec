"""A timestep that is set after the motors."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for joint, angle in enumerate([0, 1.0, 0, -1.0, 0, 0.5, 0]):
    p.resetJointState(arm, joint, angle)
    p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, angle, force=100)
p.setTimeStep(1 / 60)
for _ in range(480):
    p.stepSimulation()

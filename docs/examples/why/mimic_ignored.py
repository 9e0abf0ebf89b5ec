"""A gripper of which one finger moves."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
p.setJointMotorControl2(arm, 9, p.POSITION_CONTROL, 0.03, force=20)
for _ in range(240):
    p.stepSimulation()

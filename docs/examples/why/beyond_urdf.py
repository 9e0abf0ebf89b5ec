"""An arm that is faster than the real one."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
pose = [0.8, 0.5, 0.3, -1.5, 0.2, 2.0, 0.8]
p.setJointMotorControlArray(arm, range(7), p.POSITION_CONTROL, pose)
for _ in range(240):
    p.stepSimulation()

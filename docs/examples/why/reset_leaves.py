"""An arm that is put home, and leaves."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
home, away = [0, -0.3, 0, -2.2, 0, 2.0, 0.8], [0.6, 0.3, 0.2, -1.5, 0, 2.5, 0.8]
p.setJointMotorControlArray(arm, range(7), p.POSITION_CONTROL, away, forces=[87] * 7)
for _ in range(240):
    p.stepSimulation()
for joint, angle in enumerate(home):
    p.resetJointState(arm, joint, angle)
for _ in range(240):
    p.stepSimulation()

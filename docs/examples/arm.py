"""Send an arm to a pose that it cannot hold, and ask why it sags."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
pose = [0, 0.8, 0, -1.2, 0, 0.5, 0]
for joint, angle in enumerate(pose):
    p.resetJointState(arm, joint, angle)
    p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, angle, force=30)
for _ in range(720):
    p.stepSimulation()

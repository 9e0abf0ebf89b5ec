"""A hand that rests beside the point it was sent to."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
angles = p.calculateInverseKinematics(arm, 6, [0.5, 0.3, 0.5])
p.setJointMotorControlArray(arm, range(7), p.POSITION_CONTROL, angles, forces=[500] * 7)
for _ in range(600):
    p.stepSimulation()

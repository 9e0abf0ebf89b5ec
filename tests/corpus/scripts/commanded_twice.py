"""I send the joint to 1 rad at no more than 0.5 rad/s, and it turns on and on."""

import sys

import pybullet as p
import pybullet_data

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for _ in range(720):
    if FIX:
        p.setJointMotorControl2(arm, 0, p.POSITION_CONTROL, 1, force=300, maxVelocity=0.5)
    else:
        p.setJointMotorControl2(arm, 0, p.POSITION_CONTROL, 1, force=300)
        p.setJointMotorControl2(arm, 0, p.VELOCITY_CONTROL, targetVelocity=0.5, force=300)
    p.stepSimulation()
print("joint at", p.getJointState(arm, 0)[0])

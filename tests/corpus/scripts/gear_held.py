"""I coupled both fingers with a gear and open one of them, and both stay closed."""

import sys

import pybullet as p
import pybullet_data

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
panda = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
for finger in (9, 10):
    p.resetJointState(panda, finger, 0.0)
gear = p.createConstraint(panda, 9, panda, 10, p.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0])
p.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=50)
p.setJointMotorControl2(panda, 9, p.POSITION_CONTROL, 0.03, force=20)
if FIX:
    p.setJointMotorControl2(panda, 10, p.VELOCITY_CONTROL, force=0)
for _ in range(480):
    p.stepSimulation()
print("fingers", p.getJointState(panda, 9)[0], p.getJointState(panda, 10)[0])

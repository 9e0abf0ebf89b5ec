"""I move the arm to a pose and let it go, and it sinks by itself."""

import sys

import pybullet as p
import pybullet_data

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
pose = [0, 1.2, 0, -0.5, 0, 0.3, 0]
for j, q in enumerate(pose):
    p.resetJointState(arm, j, q)
# A tool of 25 kg on the hand.
p.changeDynamics(arm, 6, mass=25)
for i in range(1200):
    if FIX:
        p.setJointMotorControlArray(arm, range(7), p.POSITION_CONTROL, targetPositions=pose, forces=[600] * 7)
    p.stepSimulation()
print("joints", [round(p.getJointState(arm, j)[0] - q, 4) for j, q in enumerate(pose)])

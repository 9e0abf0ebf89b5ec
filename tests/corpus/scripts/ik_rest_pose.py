"""With null-space lists the hand is 16 cm off; without them it is right."""

import sys

import pybullet as p
import pybullet_data

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
rest = [0.8, -0.6, 0.5, 1.4, -0.8, -1.0, 0.5]
goal = [0.45, 0.2, 0.55]
lower, upper, span = [-0.9] * 7, [2.0] * 7, [1.5] * 7
for j in range(7):
    p.resetJointState(arm, j, 0.1)
for _ in range(960):
    if FIX:
        angles = p.calculateInverseKinematics(arm, 6, goal)
    else:
        angles = p.calculateInverseKinematics(arm, 6, goal, lowerLimits=lower, upperLimits=upper, jointRanges=span, restPoses=rest)
    for j, q in enumerate(angles):
        p.setJointMotorControl2(arm, j, p.POSITION_CONTROL, q, force=500)
    p.stepSimulation()
hand = p.getLinkState(arm, 6, computeForwardKinematics=True)[4]
print("hand off by", round(1000 * sum((a - b) ** 2 for a, b in zip(hand, goal)) ** 0.5, 2), "mm; joints off their targets", round(max(abs(p.getJointState(arm, j)[0] - q) for j, q in enumerate(angles)), 5))

"""My hand ends off the point, though inverse kinematics gives the right angles."""

import pathlib
import sys
import tempfile

import pybullet as p

FIX = "fix" in sys.argv
link = '<link name="{0}"><inertial><origin xyz="0 0 0.15"/><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>'
joint = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="0 0 {4}"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="500" velocity="10"/></joint>'
parts = [("shoulder", "revolute", "base", "upper", 0.1), ("plate", "fixed", "upper", "mount", 0.3),
         ("elbow", "revolute", "mount", "fore", 0.05), ("wrist", "revolute", "fore", "palm", 0.3), ("tip", "fixed", "palm", "hand", 0.2)]
links = "".join(link.format(name) for name in ("base", "upper", "mount", "fore", "palm", "hand"))
path = pathlib.Path(tempfile.mkdtemp(), "arm.urdf")
path.write_text(f'<robot name="arm">{links}{"".join(joint.format(*each) for each in parts)}</robot>')
p.connect(p.DIRECT)
arm = p.loadURDF(str(path), useFixedBase=True)
for j in (0, 2, 3):
    p.resetJointState(arm, j, 0.3)
goal = [0.35, 0, 0.6]
for _ in range(480):
    answer = p.calculateInverseKinematics(arm, 4, goal, maxNumIterations=200)
    joints = (0, 2, 3) if FIX else range(len(answer))
    for j, q in zip(joints, answer):
        p.setJointMotorControl2(arm, j, p.POSITION_CONTROL, q, force=500)
    p.stepSimulation()
hand = p.getLinkState(arm, 4)[4]
print("off", sum((a - b) ** 2 for a, b in zip(hand, goal)) ** 0.5)

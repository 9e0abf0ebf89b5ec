"""The parts of the gripper come apart when it grips with more force."""

import pathlib
import sys
import tempfile

import pybullet as p

FIX = "fix" in sys.argv
inertial = '<inertial><origin xyz="{0}"/><mass value="{1}"/><inertia ixx="{2}" ixy="0" ixz="0" iyy="{2}" iyz="0" izz="{2}"/></inertial>'
bar = inertial.format("0 0 0.03", 0.02, 1e-5)
joint = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1000" velocity="10"/></joint>'
# A parallelogram: an outer bar that is driven, an inner one that follows, and the finger between their tops.
path = pathlib.Path(tempfile.mkdtemp()) / "finger.urdf"
path.write_text(f"""<robot name="finger"><link name="palm">{inertial.format("0 0 0", 1, 0.01)}</link>
<link name="outer">{bar}</link>{joint.format("drive", "palm", "outer", "0.05 0 0")}
<link name="pad">{inertial.format("0.0 0 0.02", 0.02, 1e-5)}<collision><origin xyz="-0.015 0 0.03"/><geometry><box size="0.01 0.02 0.06"/></geometry></collision></link>{joint.format("top", "outer", "pad", "0 0 0.06")}
<link name="inner">{bar}</link>{joint.format("follow", "palm", "inner", "0.02 0 0")}</robot>""")
p.connect(p.DIRECT)
hand = p.loadURDF(str(path), useFixedBase=True)
block = p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.05, 0.03]), basePosition=[-0.02, 0, 0.09])
for j in range(3):
    p.setJointMotorControl2(hand, j, p.VELOCITY_CONTROL, force=0)
link = p.createConstraint(hand, 1, hand, 2, p.JOINT_POINT2POINT, [0, 0, 0], [-0.03, 0, -0.02], [0, 0, 0.03])
p.changeConstraint(link, maxForce=5000)
for _ in range(720):
    p.setJointMotorControl2(hand, 0, p.POSITION_CONTROL, -0.9, force=2 if FIX else 20)
    p.stepSimulation()
import numpy as np
pad, inner = p.getLinkState(hand, 1), p.getLinkState(hand, 2)
a = p.multiplyTransforms(pad[0], pad[1], [-0.03, 0, -0.02], [0, 0, 0, 1])[0]
b = p.multiplyTransforms(inner[0], inner[1], [0, 0, 0.03], [0, 0, 0, 1])[0]
print("ends apart by", round(1000 * float(np.linalg.norm(np.subtract(a, b))), 3), "mm; pad turned by", round(p.getJointState(hand, 0)[0] + p.getJointState(hand, 1)[0], 3))

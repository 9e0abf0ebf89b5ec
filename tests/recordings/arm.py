"""An arm pushes a box: motors, a constraint, a push, states that are set, contacts; 60 steps."""

from pathlib import Path

import pybullet as p
import pybullet_data

LINK = """<link name="{name}"><inertial><mass value="1"/><origin xyz="0 0 0.15"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 0.15"/><geometry><box size="0.04 0.04 0.3"/></geometry></collision>
</link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0 0 {z}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="9"/>
<dynamics damping="0.1"/></joint>"""
Path("arm.urdf").write_text(
    '<robot name="arm">'
    + "".join(LINK.format(name=name) for name in ("base", "upper", "lower"))
    + JOINT.format(name="shoulder", kind="revolute", parent="base", child="upper", z=0.3)
    + JOINT.format(name="elbow", kind="revolute", parent="upper", child="lower", z=0.3)
    + "</robot>"
)

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
arm = p.loadURDF("arm.urdf", useFixedBase=True)
box = p.loadURDF("cube_small.urdf", [0.53, 0, 0.025])
hung = p.loadURDF("cube_small.urdf", [0, 0.5, 0.4])
p.changeDynamics(box, -1, lateralFriction=0.4, linearDamping=0.01)
p.resetJointState(arm, 0, 1.7)
p.resetJointState(arm, 1, 0.8)
nowhere = [0, 0, 0]
held = p.createConstraint(hung, -1, -1, -1, p.JOINT_POINT2POINT, nowhere, nowhere, [0, 0.5, 0.4])
p.changeConstraint(held, maxForce=5)
view = p.computeViewMatrix([1, 1, 1], [0.5, 0, 0], [0, 0, 1])
lens = p.computeProjectionMatrixFOV(60, 4 / 3, 0.1, 5)
for i in range(60):
    p.setJointMotorControl2(arm, 0, p.POSITION_CONTROL, targetPosition=1.7, force=80)
    p.setJointMotorControl2(arm, 1, p.POSITION_CONTROL, targetPosition=0.8 - 0.006 * i, force=80)
    if i == 30:
        p.applyExternalForce(box, -1, [0.5, 0, 0], [0, 0, 0], p.LINK_FRAME)
    if i == 40:
        p.resetBaseVelocity(hung, [0.1, 0, 0])
    if i == 20:
        p.getCameraImage(16, 12, view, lens, renderer=p.ER_TINY_RENDERER)
    p.stepSimulation()
    p.getJointStates(arm, range(2)), p.getLinkState(arm, 1), p.getContactPoints(box)

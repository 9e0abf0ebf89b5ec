"""A gripper lifts a block."""

import pathlib
import tempfile

import pybullet as p
import pybullet_data

path = pathlib.Path(tempfile.mkdtemp(), "robot.urdf")
path.write_text("""<robot name="gantry">
<link name="base"/>
<link name="slide"><inertial><mass value="1.5"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="left"><inertial><mass value="0.2"/><inertia ixx="0.0005" iyy="0.0005" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><box size="0.03 0.01 0.08"/></geometry></collision></link>
<link name="right"><inertial><mass value="0.2"/><inertia ixx="0.0005" iyy="0.0005" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><box size="0.03 0.01 0.08"/></geometry></collision></link>
<joint name="lift" type="prismatic"><parent link="base"/><child link="slide"/><origin xyz="0 0 0.14"/><axis xyz="0 0 1"/><limit lower="-0.2" upper="0.5" effort="200" velocity="1"/></joint>
<joint name="left_finger" type="prismatic"><parent link="slide"/><child link="left"/><origin xyz="0 0.05 -0.1"/><axis xyz="0 -1 0"/><limit lower="0" upper="0.05" effort="60" velocity="1"/></joint>
<joint name="right_finger" type="prismatic"><parent link="slide"/><child link="right"/><origin xyz="0 -0.05 -0.1"/><axis xyz="0 1 0"/><limit lower="0" upper="0.05" effort="60" velocity="1"/></joint>
</robot>""")
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
floor = p.loadURDF("plane.urdf")
for k in range(3):
    p.loadURDF("cube_small.urdf", [4 + 0.4*k, 3, 0.025])
hand = p.loadURDF(str(path), [0, 0, 0], useFixedBase=True)
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.014, 0.014, 0.04])
block = p.createMultiBody(0.279, box, -1, [0, 0, 0.04])
p.changeDynamics(block, -1, lateralFriction=1.0)
for j in (1, 2):
    p.changeDynamics(hand, j, lateralFriction=1.0)
for i in range(720):
    close = 0.05 if i > 60 else 0.0
    rise = 0.0 if i < 240 else min(0.15, 0.001*(i - 240))
    p.setJointMotorControl2(hand, 0, p.POSITION_CONTROL, targetPosition=rise, force=150)
    for j in (1, 2):
        p.setJointMotorControl2(hand, j, p.POSITION_CONTROL, targetPosition=close, force=25.1)
    p.stepSimulation()
print("block_height", p.getBasePositionAndOrientation(block)[0][2], "want", 0.19)
p.disconnect()

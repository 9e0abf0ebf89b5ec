"""The hexapod slides over the floor while it stands still."""

import math
import pathlib
import sys
import tempfile

import pybullet as p

FIX = "fix" in sys.argv
inertial = '<inertial><origin xyz="{0}"/><mass value="{1}"/><inertia ixx="{2}" ixy="0" ixz="0" iyy="{2}" iyz="0" izz="{2}"/></inertial>'
legs = ""
for i in range(6):
    angle = math.pi / 3 * i + 0.2
    legs += f"""<link name="femur{i}">{inertial.format("0.06 0 0", 0.1, 1e-4)}</link>
<joint name="hip{i}" type="revolute"><parent link="body"/><child link="femur{i}"/><origin xyz="{0.1 * math.cos(angle)} {0.1 * math.sin(angle)} 0" rpy="0 0 {angle}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="5" velocity="6"/></joint>
<link name="tibia{i}"><contact><lateral_friction value="0.6"/><stiffness value="10000"/><damping value="100"/></contact>{inertial.format("0 0 -0.06", 0.1, 1e-4)}<collision><origin xyz="0 0 -0.12"/><geometry><sphere radius="0.01"/></geometry></collision></link>
<joint name="knee{i}" type="revolute"><parent link="femur{i}"/><child link="tibia{i}"/><origin xyz="0.12 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="5" velocity="6"/></joint>"""
path = pathlib.Path(tempfile.mkdtemp()) / "hexapod.urdf"
path.write_text(f'<robot name="hexapod"><link name="body">{inertial.format("0.01 0.005 0", 1.0, 0.005)}<collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision></link>{legs}</robot>')
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
p.setTimeStep(0.03)  # the timestep of the environment (kraby #10)
if FIX:
    p.setPhysicsEngineParameter(enableConeFriction=0)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[5, 5, 0.1]), basePosition=[0, 0, -0.1])
robot = p.loadURDF(str(path), [0, 0, 0.135])
for j in range(12):
    p.setJointMotorControl2(robot, j, p.POSITION_CONTROL, 0.0, force=5)
for i in range(333):
    p.stepSimulation()
    if i == 33:
        start = p.getBasePositionAndOrientation(robot)[0]
end, turn = p.getBasePositionAndOrientation(robot)
print("slid by", [round(1000 * (e - s), 2) for e, s in zip(end, start)], "mm in 9 s, yaw", round(p.getEulerFromQuaternion(turn)[2], 4))

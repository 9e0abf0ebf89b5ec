"""Two pulleys joined with JOINT_GEAR: the second does not keep its direction when the arm turns."""

import pathlib
import sys
import tempfile

import pybullet as p

FIX = "fix" in sys.argv
inertial = '<inertial><origin xyz="{0}"/><mass value="{1}"/><inertia ixx="{2}" ixy="0" ixz="0" iyy="{2}" iyz="0" izz="{2}"/></inertial>'
joint = '<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}"/><axis xyz="0 1 0"/></joint>'
path = pathlib.Path(tempfile.mkdtemp()) / "belt.urdf"
path.write_text(f"""<robot name="belt"><link name="base">{inertial.format("0 0 0", 1, 0.01)}</link>
<link name="arm">{inertial.format("0.15 0 0", 0.5, 0.005)}</link>{joint.format("shoulder", "base", "arm", "0 0 0")}
<link name="pulley">{inertial.format("0 0 0", 0.1, 1e-4)}</link>{joint.format("end", "arm", "pulley", "0.3 0 0")}</robot>""")
p.connect(p.DIRECT)
robot = p.loadURDF(str(path), useFixedBase=True)
p.setJointMotorControl2(robot, 1, p.VELOCITY_CONTROL, force=0)
# A belt from a pulley that stands still on the base to one at the arm's end: the end must turn back by what the arm turns.
gear = p.createConstraint(robot, 0, robot, 1, p.JOINT_GEAR, [0, 1, 0], [0, 0, 0], [0, 0, 0])
p.changeConstraint(gear, gearRatio=1 if FIX else -1, erp=0.2, maxForce=100)
for _ in range(480):
    p.setJointMotorControl2(robot, 0, p.POSITION_CONTROL, 0.8, force=20, maxVelocity=1)
    p.stepSimulation()
arm, end = p.getJointState(robot, 0)[0], p.getJointState(robot, 1)[0]
print("arm", round(arm, 3), "end", round(end, 3), "direction of the last pulley", round(arm + end, 3), "should be 0")

"""The joint damping in my MJCF file has no effect, be it 1 or 100000."""

import pathlib
import sys
import tempfile

import pybullet as p

FIX = "fix" in sys.argv
path = pathlib.Path(tempfile.mkdtemp()) / "swing.xml"
path.write_text("""<mujoco model="swing"><compiler angle="radian"/><default><joint damping="1" armature="0"/></default><worldbody>
<body name="pole" pos="0 0 1"><joint name="hinge" type="hinge" axis="0 1 0" pos="0 0 0" damping="1"/><geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02"/></body>
</worldbody></mujoco>""")
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
(swing,) = p.loadMJCF(str(path))
hinge = next(j for j in range(p.getNumJoints(swing)) if p.getJointInfo(swing, j)[2] == p.JOINT_REVOLUTE)
p.setJointMotorControl2(swing, hinge, p.VELOCITY_CONTROL, force=0)
if FIX:
    p.changeDynamics(swing, hinge, jointDamping=1)
fastest = 0
for _ in range(480):
    p.stepSimulation()
    fastest = max(fastest, abs(p.getJointState(swing, hinge)[1]))
print("fastest", round(fastest, 3), "rad/s; with a damping of 1 at most", round(0.54 * 9.81 * 0.2 / 1, 3))

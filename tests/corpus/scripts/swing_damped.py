"""My pendulum's motor is off, and it comes to rest within two swings."""

import os
import sys
import tempfile

import pybullet as p

FIX = "fix" in sys.argv
POLE = """<robot name="pole"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/>
<mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
</link><joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/>
<axis xyz="0 1 0"/><dynamics damping="0.5"/></joint></robot>"""
path = os.path.join(tempfile.mkdtemp(), "pole.urdf")
with open(path, "w") as file:
    file.write(POLE)
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
pole = p.loadURDF(path, useFixedBase=True)
p.setJointMotorControl2(pole, 0, p.VELOCITY_CONTROL, force=0)
p.changeDynamics(pole, 0, linearDamping=0, angularDamping=0)
if FIX:
    p.changeDynamics(pole, 0, jointDamping=0)
p.resetJointState(pole, 0, 1.0)
most = 0.0
for i in range(960):
    p.stepSimulation()
    if i > 720:
        most = max(most, abs(p.getJointState(pole, 0)[0]))
print("largest angle in the last second", most)

"""A shuttle carries a crate to and fro."""

import math
import pathlib
import tempfile

import pybullet as p
import pybullet_data

path = pathlib.Path(tempfile.mkdtemp(), "robot.urdf")
path.write_text("""<robot name="cart">
<link name="rail"/>
<link name="cart"><inertial><mass value="3"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><box size="0.2 0.1 0.1"/></geometry></collision></link>
<joint name="rail_to_cart" type="prismatic"><parent link="rail"/><child link="cart"/><origin xyz="0 0 0.5"/><axis xyz="1 0 0"/><limit lower="-20" upper="20" effort="100" velocity="10"/></joint>
</robot>""")

class Env:
    def __init__(self):
        self.client = p.connect(p.DIRECT)
        p.setAdditionalSearchPath(pybullet_data.getDataPath())

    def reset(self):
        p.resetSimulation()
        p.setGravity(0, 0, -9.81)
        self.floor = p.loadURDF("plane.urdf")
        # a shuttle that carries a crate to and fro
        self.cart = p.loadURDF(str(path), useFixedBase=True)
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.03, 0.03, 0.03])
        self.crate = p.createMultiBody(0.364, box, -1, [0, 0, 0.5801])
        p.changeDynamics(self.cart, 0, lateralFriction=1)
        p.changeDynamics(self.crate, -1, lateralFriction=1)

    def step(self, i):
        s = 0.162*(1 - math.cos(2*math.pi*i/480))/2
        p.setJointMotorControl2(self.cart, 0, p.POSITION_CONTROL, targetPosition=s, targetVelocity=0.162*math.pi/2*math.sin(2*math.pi*i/480), force=200)
        p.stepSimulation()

    def report(self):
        print("crate_x", p.getBasePositionAndOrientation(self.crate)[0][0])

env = Env()
for episode in range(2):
    env.reset()
    for i in range(960):
        env.step(i)
    env.report()

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


open("point.urdf", "w").write(
    '<robot name="r"><link name="b"><inertial><mass value="1"/><inertia '
    'ixx=".5" iyy=".5" izz=".5" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
)
b = p.loadURDF("point.urdf")
for i in range(60):
    p.applyExternalTorque(b, -1, [0.001, 0.001, 0], p.WORLD_FRAME)
    steps(1)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


b = p.loadURDF("cube_small.urdf", [0, 0, 1])
for kind in (p.JOINT_FIXED, p.JOINT_POINT2POINT):
    c = p.createConstraint(b, -1, -1, -1, kind, [0, 0, 0], [0, 0, 0], [0, 0, 1])
    steps(20)
    p.removeConstraint(c)

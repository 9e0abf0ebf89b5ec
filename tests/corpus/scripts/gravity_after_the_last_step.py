import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


c = p.loadURDF("cube_small.urdf", [0, 0, 1])

steps(60)
p.setGravity(0, 0, -9.81)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


other = p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81, physicsClientId=other)
p.loadURDF("cube_small.urdf", physicsClientId=other)
p.setGravity(0, 0, -9.81)
p.loadURDF("cube_small.urdf")
steps(30)

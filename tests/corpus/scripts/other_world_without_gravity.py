import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


other = p.connect(p.DIRECT)
p.loadURDF("cube_small.urdf", [0, 0, 1], physicsClientId=other)
p.setGravity(0, 0, -9.81)
p.loadURDF("cube_small.urdf", [0, 0, 1])
for _ in range(60):
    p.stepSimulation()
    p.stepSimulation(physicsClientId=other)

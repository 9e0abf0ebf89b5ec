import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


b = p.createMultiBody(1, -1, -1, [0, 0, 2])
for _ in range(20):
    p.applyExternalForce(b, -1, [0, 1, 0], [0, 0, 0], p.WORLD_FRAME)
    steps(1)

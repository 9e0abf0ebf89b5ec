import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)


def box(mass, at, half=(0.05, 0.05, 0.05), mu=0.5):
    b = p.createMultiBody(mass, p.createCollisionShape(p.GEOM_BOX, halfExtents=half), -1, at)
    p.changeDynamics(b, -1, lateralFriction=mu)
    return b


b = box(0, [0, 0, 1])
for _ in range(60):
    p.applyExternalForce(b, -1, [50, 0, 0], [0, 0, 0], p.LINK_FRAME)
    steps(1)

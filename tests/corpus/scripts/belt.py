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


t = box(0, [0, 0, 0.5], (1, 0.3, 0.05), mu=1)
b = box(1, [0, 0, 0.6], mu=1)
for i in range(240):
    p.resetBasePositionAndOrientation(t, [0, 0, 0.5], [0, 0, 0, 1])
    p.resetBaseVelocity(t, [0.3, 0, 0], [0, 0, 0])
    p.stepSimulation()

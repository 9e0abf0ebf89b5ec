import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")


def box(mass, at, half=(0.05, 0.05, 0.05), mu=0.5):
    b = p.createMultiBody(mass, p.createCollisionShape(p.GEOM_BOX, halfExtents=half), -1, at)
    p.changeDynamics(b, -1, lateralFriction=mu)
    return b


row = [box(0.1, [0.04 * i, 0, 0.05], (0.005, 0.025, 0.05)) for i in range(6)]
steps(60)
p.resetBaseVelocity(row[0], [0.3, 0, 0], [0, 3, 0])
steps(240)

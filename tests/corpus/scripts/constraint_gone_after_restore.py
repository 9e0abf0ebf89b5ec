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


b = box(1, [0, 0, 2])
c = p.createConstraint(b, -1, -1, -1, p.JOINT_FIXED, [0] * 3, [0] * 3, [0, 0, 2])
steps(10)
s = p.saveState()
steps(60)
p.removeConstraint(c)
steps(30)
p.restoreState(s)
steps(60)

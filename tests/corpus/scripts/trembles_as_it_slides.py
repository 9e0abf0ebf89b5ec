import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
f = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.03])
b = p.createMultiBody(1, box, -1, [0, 0, 0.03])
steps(60)
p.resetBaseVelocity(b, [2, 2, 0])
steps(110)

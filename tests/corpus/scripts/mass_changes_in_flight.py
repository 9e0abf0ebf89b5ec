import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.2, 0.3])
b = p.createMultiBody(1, box)
p.resetBaseVelocity(b, [0, 0, 0], [0.1, 0.1, 0.1])
p.changeDynamics(b, -1, linearDamping=0, angularDamping=0)
steps(60)
p.changeDynamics(b, -1, mass=5)
steps(60)

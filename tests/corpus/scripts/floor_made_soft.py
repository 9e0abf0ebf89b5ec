import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
floor = p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[2, 2, 0.5]))
p.changeDynamics(floor, -1, contactStiffness=300, contactDamping=50)
cube = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.15] * 3)
b = p.createMultiBody(2, cube, -1, [0, 0, 0.65])
steps(300)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
plate = p.createCollisionShape(p.GEOM_BOX, halfExtents=[3, 0.3, 0.05])
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.08, 0.06])
belt = p.createMultiBody(0, plate, -1, [0, 0, 0.3])

cube = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3)
b = p.createMultiBody(2, cube, -1, [0, 0, 0.45])
for i in range(240):
    p.resetBasePositionAndOrientation(belt, [0, 0, 0.3 + 3 * i / 240], [0, 0, 0, 1])
    p.resetBaseVelocity(belt, [0, 0, 3])
    steps(1)

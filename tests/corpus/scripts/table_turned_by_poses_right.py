import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
disc = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.6, height=0.1)
table = p.createMultiBody(0, disc, -1, [0, 0, 0.5])
cube = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05] * 3)
b = p.createMultiBody(0.2, cube, -1, [0.3, 0, 0.6])
for i in range(240):
    turned = p.getQuaternionFromEuler([0, 0, 0.8 * i / 240])
    p.resetBasePositionAndOrientation(table, [0, 0, 0.5], turned)
    p.resetBaseVelocity(table, [0, 0, 0], [0, 0, 0.8])
    steps(1)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
b = p.createMultiBody(1, ball, -1, [0, 0, 0.5])
steps(72)
p.resetBaseVelocity(b, [1, 0, 0], [0, 10, 0])
steps(100)

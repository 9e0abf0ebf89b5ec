import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
p.createMultiBody(1, ball)
steps(800)

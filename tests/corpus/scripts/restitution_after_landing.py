import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
b = p.createMultiBody(1, ball, -1, [0, 0, 0.6])
steps(200)
p.changeDynamics(b, -1, restitution=0.9)
steps(20)

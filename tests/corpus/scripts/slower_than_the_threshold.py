import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
for x in (0, 0.25):
    b = p.createMultiBody(1, shape, -1, [x, 0, 0])
    p.changeDynamics(b, -1, restitution=0.95, linearDamping=0, angularDamping=0)
p.resetBaseVelocity(0, [0.19, 0, 0])
steps(120)

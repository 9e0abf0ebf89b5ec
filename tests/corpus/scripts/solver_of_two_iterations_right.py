import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.setPhysicsEngineParameter(numSolverIterations=50)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
cube = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3)
for k in range(12):
    p.createMultiBody(1, cube, -1, [0, 0, 0.1 + 0.2 * k])
steps(120)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3)
p.createMultiBody(0, box)
p.createMultiBody(1, box, p.createVisualShape(p.GEOM_SPHERE, radius=0.1), [0, 0, 0.15])
steps(20)

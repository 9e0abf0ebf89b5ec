import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
cube = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05] * 3)
hook, b = p.createMultiBody(0, cube, -1, [0, 0, 0.7]), p.createMultiBody(1, cube, -1, [0, 0, 0.4])
c = p.createConstraint(hook, -1, b, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, -0.3], [0, 0, 0])
p.changeConstraint(c, maxForce=30)
steps(240)

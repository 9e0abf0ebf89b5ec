import pybullet as p

p.connect(p.DIRECT)
p.setGravity(0, 0, 0)
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
puck = p.createMultiBody(1, shape, -1, [0, 0, 1])
p.changeDynamics(puck, -1, linearDamping=700, angularDamping=0)
p.resetBaseVelocity(puck, [1, 0, 0])
for _ in range(60):
    p.stepSimulation()
print(p.getBaseVelocity(puck)[0][0], "m/s")

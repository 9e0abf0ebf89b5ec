"""A ball that bounces ever higher."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
floor = p.loadURDF("plane.urdf")
ball = p.createMultiBody(
    1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.5), basePosition=[0, 0, 5.5]
)
p.changeDynamics(floor, -1, restitution=1)
p.changeDynamics(ball, -1, restitution=1, linearDamping=0, angularDamping=0)
for _ in range(2400):
    p.stepSimulation()

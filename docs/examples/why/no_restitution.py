"""A ball that does not bounce."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
ball = p.createMultiBody(
    1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), basePosition=[0, 0, 1]
)
p.changeDynamics(ball, -1, restitution=0.9)
for _ in range(240):
    p.stepSimulation()

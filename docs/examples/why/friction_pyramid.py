"""A slide that turns."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
p.setPhysicsEngineParameter(enableConeFriction=0)
puck = p.createMultiBody(
    1, p.createCollisionShape(p.GEOM_CYLINDER, radius=0.1, height=0.05), basePosition=[0, 0, 0.025]
)
for _ in range(10):
    p.stepSimulation()
p.resetBaseVelocity(puck, [3, 1.5, 0])
for _ in range(240):
    p.stepSimulation()

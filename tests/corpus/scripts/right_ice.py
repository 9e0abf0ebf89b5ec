"""An ice slide: the crate is to slide down it."""

import math
import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
floor = p.loadURDF("plane.urdf")
# an ice slide: the crate is meant to slide down it
ice = p.createCollisionShape(p.GEOM_BOX, halfExtents=[1.5, 0.4, 0.02])
slope = p.createMultiBody(0, ice, -1, [0, 0, 1], p.getQuaternionFromEuler([0, 0.443, 0]))
crate = p.loadURDF("cube_small.urdf", [-0.5*math.cos(0.443) + 0.046*math.sin(0.443), 0, 1 + 0.5*math.sin(0.443) + 0.046*math.cos(0.443)], p.getQuaternionFromEuler([0, 0.443, 0]))
p.changeDynamics(slope, -1, lateralFriction=0.05)
p.changeDynamics(crate, -1, lateralFriction=0.05, linearDamping=0, angularDamping=0)
for i in range(120):
    p.stepSimulation()
print("speed", math.hypot(*p.getBaseVelocity(crate)[0]))
p.disconnect()

"""A crate on a ramp."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
plate = p.createCollisionShape(p.GEOM_BOX, halfExtents=[2, 1, 0.1])
tilted = p.getQuaternionFromEuler([0, 0.45, 0])
ramp = p.createMultiBody(0, plate, baseOrientation=tilted)
crate = p.createMultiBody(1, box, basePosition=[0.087, 0, 0.18], baseOrientation=tilted)
p.changeDynamics(ramp, -1, lateralFriction=0.6)
for _ in range(240):
    p.stepSimulation()

"""My stack of four boxes collapses as soon as it is let go."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
floor = p.loadURDF("plane.urdf")
for k in range(2):
    p.loadURDF("sphere_small.urdf", [4 + 0.4*k, 3, 0.03])
small = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05, 0.05, 0.05])
stack = [p.createMultiBody(218.0 if k == 3 else 0.1, small, -1, [0, 0, 0.05 + 0.1*k]) for k in range(4)]
for i in range(480):
    p.stepSimulation()
print("top", p.getBasePositionAndOrientation(stack[3])[0][2], "want", 0.35)
p.disconnect()

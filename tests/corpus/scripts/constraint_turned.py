"""I fix my box in the air where it is, and it spins around at once."""
import sys
import pybullet as p

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
turned = p.getQuaternionFromEuler([0, 0, 2.4])
box = p.createMultiBody(1, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.05, 0.05]), -1, [0, 0, 1], turned)
p.createConstraint(box, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 1], childFrameOrientation=turned if FIX else [0, 0, 0, 1])
for _ in range(120):
    p.stepSimulation()
print("yaw", p.getEulerFromQuaternion(p.getBasePositionAndOrientation(box)[1])[2])

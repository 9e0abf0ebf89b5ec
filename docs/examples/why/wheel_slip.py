"""A robot that spins its wheels."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
husky = p.loadURDF("husky/husky.urdf", [0, 0, 0.14])
for wheel in (2, 3, 4, 5):
    p.changeDynamics(husky, wheel, lateralFriction=0.05)
    p.setJointMotorControl2(husky, wheel, p.VELOCITY_CONTROL, targetVelocity=12, force=50)
for _ in range(480):
    p.stepSimulation()

"""A cart balances a pole; its motor's force is the control."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
cart = p.loadURDF("cartpole.urdf")
for joint in (0, 1):
    p.setJointMotorControl2(cart, joint, p.VELOCITY_CONTROL, targetVelocity=10, force=0)
p.resetJointState(cart, 1, 0.05)
for step in range(1200):
    x, dx = p.getJointState(cart, 0)[:2]
    angle, rate = p.getJointState(cart, 1)[:2]
    u = 60 * angle + 12 * rate + 1.5 * x + 3 * dx
    p.setJointMotorControl2(cart, 0, p.VELOCITY_CONTROL, targetVelocity=100 if u > 0 else -100, force=abs(u))
    p.stepSimulation()
print("angle", angle, "x", x)

"""My policy's torques do not hold the arm."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.setTimeStep(1/1000)
floor = p.loadURDF("plane.urdf")
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
goal = [0, 0.805, 0, -1.112, 0, 0.5, 0]
for j in range(7):
    p.resetJointState(arm, j, goal[j])
    p.setJointMotorControl2(arm, j, p.VELOCITY_CONTROL, force=0)
scale = [1.0, 1.0, 1.0, 1.0, 1.0/4, 1.0/8, 1.0/20]
for i in range(1500):
    for j in range(7):
        q, qd = p.getJointState(arm, j)[:2]
        action = max(-1, min(1, 8*(goal[j] - q) - 0.3*qd))
        p.setJointMotorControl2(arm, j, p.TORQUE_CONTROL, force=scale[j]*action)
    p.stepSimulation()
q = [p.getJointState(arm, j)[0] for j in range(7)]
print("worst", max(abs(a - b) for a, b in zip(q, goal)), "want", 0)
p.disconnect()

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.setTimeStep(0.02)
c = p.loadURDF("cartpole.urdf")
for j in (0, 1):
    p.setJointMotorControl2(c, j, p.VELOCITY_CONTROL, force=0)
for _ in range(100):
    push = -10 if p.getJointState(c, 0)[1] > 0 else 10
    p.setJointMotorControl2(c, 0, p.TORQUE_CONTROL, force=push)
    p.stepSimulation()

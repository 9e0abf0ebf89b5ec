import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


c = p.loadURDF("cartpole.urdf")
for j in (0, 1):
    p.setJointMotorControl2(c, j, p.VELOCITY_CONTROL, force=0)
for _ in range(60):
    x, v, _, _ = p.getJointState(c, 0)
    p.setJointMotorControl2(c, 0, p.TORQUE_CONTROL, force=9 * (1 - x) - 9 * v)
    steps(1)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


c = p.loadURDF("cartpole.urdf")
p.setJointMotorControl2(c, 0, p.VELOCITY_CONTROL, force=0)
p.setJointMotorControl2(c, 0, p.TORQUE_CONTROL, force=50)
steps(60)

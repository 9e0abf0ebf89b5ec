import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)

for i in range(480):
    for j in range(7):
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0.4 - 0.001 * i, force=5)
    p.stepSimulation()

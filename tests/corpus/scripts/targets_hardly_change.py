import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for i in range(300):
    p.setJointMotorControl2(k, 1, p.POSITION_CONTROL, 0.8 + 1e-4 * 0.9**i, force=100)
    p.stepSimulation()

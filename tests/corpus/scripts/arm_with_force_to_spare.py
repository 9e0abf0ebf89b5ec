import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for j, q in enumerate([0, 0.8, 0, -1.2, 0, 0.6, 0]):
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=60)
steps(720)

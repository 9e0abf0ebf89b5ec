import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)


def to(q):
    for j in range(7):
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=300)


def back(q):
    for j in range(7):
        p.resetJointState(k, j, q)


to(0.5)
steps(120)
back(0.005)
steps(120)

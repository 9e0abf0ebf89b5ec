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


for e in range(2):
    back(0.1)
    steps(10)
    for i in range(9):
        to(0.1 * i)
        steps(9)

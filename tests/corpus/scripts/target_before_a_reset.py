import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
k = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)

home = [0, -0.4, 0, -2.2, 0, 2, 0.8]


def to(second, number):
    for j, q in enumerate(home):
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, second if j == 1 else q, force=87)
    steps(number)


for episode in range(3):
    for j, q in enumerate(home):
        p.resetJointState(k, j, q)
    steps(5)
    for second in (0.2, 0.5, 0.8):
        to(second, 400)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


d = p.loadURDF("a1/a1.urdf", [0, 0, 0.5], useFixedBase=True)
movable = [j for j in range(p.getNumJoints(d)) if p.getJointInfo(d, j)[2] == 0]
for i in range(30):
    for j, q in zip(range(12), [0, 0.9, -1.8] * 4):
        p.setJointMotorControl2(d, j, p.POSITION_CONTROL, q, force=30)
    steps(1)

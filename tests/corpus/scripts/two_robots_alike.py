import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
for y in (0, 2):
    p.loadURDF("kuka_iiwa/model.urdf", [0, y, 0], useFixedBase=True)
for _ in range(60):
    p.setJointMotorControl2(1, 3, p.POSITION_CONTROL, 1.2, positionGain=1.9)
    steps(1)

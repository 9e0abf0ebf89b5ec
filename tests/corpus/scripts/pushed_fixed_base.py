import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for _ in range(60):
    p.applyExternalForce(k, -1, [50, 0, 0], [0, 0, 0], p.LINK_FRAME)
    steps(1)

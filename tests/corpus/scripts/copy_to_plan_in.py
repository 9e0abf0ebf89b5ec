import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
other = p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81, physicsClientId=other)
p.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=other)
p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True, physicsClientId=other)
p.resetJointState(0, 1, 0.5, physicsClientId=other)
for _ in range(9):
    p.stepSimulation(physicsClientId=0)
p.disconnect(other)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)

g = p.loadURDF("pr2_gripper.urdf", [0, 0, 1])
for i in range(120):
    p.resetBasePositionAndOrientation(g, [0.005 * i, 0, 1], [0, 0, 0, 1])
    p.stepSimulation()

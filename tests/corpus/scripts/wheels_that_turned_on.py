import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
c = p.loadURDF("racecar/racecar.urdf", [0, 0, 0.2])
steps(60)
p.resetBasePositionAndOrientation(c, [1, 0, 0.2], [0, 0, 0, 1])
steps(20)

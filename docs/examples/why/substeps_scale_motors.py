"""An arm that holds more than its motors can."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.setPhysicsEngineParameter(numSubSteps=4)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
pose = [0, 0.8, 0, -1.2, 0, 0.6, 0]
p.setJointMotorControlArray(arm, range(7), p.POSITION_CONTROL, pose, forces=[30] * 7)
for _ in range(480):
    p.stepSimulation()

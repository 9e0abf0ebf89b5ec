import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")

c = p.loadURDF("racecar/racecar.urdf", [0, 0, 0.2])
for j in range(p.getNumJoints(c)):
    p.setJointMotorControl2(c, j, p.VELOCITY_CONTROL, targetVelocity=20, force=50)
steps(120)
for j in range(p.getNumJoints(c)):
    p.setJointMotorControl2(c, j, p.VELOCITY_CONTROL, force=0)

p.resetBasePositionAndOrientation(c, [0, 0, 0.2], [0, 0, 0, 1])
steps(20)

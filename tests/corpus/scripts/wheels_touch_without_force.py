import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
c = p.loadURDF("racecar/racecar.urdf")
for j in (2, 3, 5, 7):
    p.setJointMotorControl2(c, j, p.VELOCITY_CONTROL, targetVelocity=20, force=10)
steps(480)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)

k = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
for j in (9, 10):
    p.resetJointState(k, j, 0.04)
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0.04, force=20)
c = p.createConstraint(k, 9, k, 10, p.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0])
p.changeConstraint(c, gearRatio=-1, erp=0.1, maxForce=50)
steps(60)

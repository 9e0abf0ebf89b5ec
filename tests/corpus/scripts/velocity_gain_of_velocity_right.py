import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)

for j in range(7):
    p.setJointMotorControl2(
        k, j, p.VELOCITY_CONTROL, targetVelocity=0.2 * (j == 0), velocityGain=1, force=50
    )
steps(240)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)

for j, q in enumerate([0, 0.8, 0, -1.2, 0, 0.6, 0]):
    p.resetJointState(k, j, q)
for i in range(120):
    q = [each[0] for each in p.getJointStates(k, range(7))]
    torques = p.calculateInverseDynamics(k, q, [0.0] * 7, [0.0] * 7)
    p.setJointMotorControlArray(k, range(7), p.TORQUE_CONTROL, forces=torques)
    p.stepSimulation()

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")

r = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
cube = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02] * 3)
b = p.createMultiBody(0.1, cube, -1, [0.5, 0, 0.02])
for body, link in ((b, -1), (r, 9), (r, 10)):
    p.changeDynamics(body, link, lateralFriction=1)
for j, q in zip(range(11), (0, 0.3, 0, -2.2, 0, 2.5, 0.785, 0, 0, 0.04, 0.04)):
    p.resetJointState(r, j, q)
down = p.getQuaternionFromEuler([3.14159, 0, 0])
for z, grip, n in ((0.2, 0.04, 240), (0.03, 0.04, 240), (0.03, 0, 120), (0.25, 0, 240)):
    for _ in range(n):
        q = p.calculateInverseKinematics(
            r, 11, [0.5, 0, z], down, maxNumIterations=100, residualThreshold=1e-5
        )
        for j in range(7):
            p.setJointMotorControl2(r, j, p.POSITION_CONTROL, q[j], force=87, maxVelocity=1)
        for j in (9, 10):
            p.setJointMotorControl2(r, j, p.POSITION_CONTROL, grip, force=20)
        steps(1)

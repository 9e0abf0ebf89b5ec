import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
k = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)

home = [0, 0.2, 0, -2, 0, 2.2, 0.78]


def go(fingers, second=0.2):
    for j, q in [*enumerate(home), (9, fingers), (10, fingers)]:
        q = second if j == 1 else q
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=2 if j > 8 else 80)


for j, q in [*enumerate(home), (9, 0.04), (10, 0.04)]:
    p.resetJointState(k, j, q)
at = p.getLinkState(k, 11, computeForwardKinematics=True)[4]
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02] * 3)
b = p.createMultiBody(0.02, s, -1, at)
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3)
p.createMultiBody(0, s, -1, [at[0], at[1], at[2] - 0.1201])
go(0)
steps(12)
go(0.015)
steps(60)
go(0.015, 0.05)
steps(60)

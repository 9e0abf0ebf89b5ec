import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)

q0 = [0, 1, 0, -0.8, 0, 0.5, 0]
arms = [p.loadURDF("kuka_iiwa/model.urdf", [0, y, 0], useFixedBase=True) for y in (-0.3, 0.3)]
for k in arms:
    for j in range(7):
        p.resetJointState(k, j, q0[j])
ends = [p.getLinkState(k, 6, computeForwardKinematics=True)[0] for k in arms]
middle = [sum(each) / 2 for each in zip(*ends)]
half = [0.02, 0.2, 0.02]
bar = p.createMultiBody(8, p.createCollisionShape(p.GEOM_BOX, halfExtents=half), -1, middle)
p.setCollisionFilterGroupMask(bar, -1, 0, 0)
for k, y in zip(arms, (-0.3, 0.3)):
    p.createConstraint(k, 6, bar, -1, p.JOINT_POINT2POINT, [0, 0, 0], [0, 0, 0], [0, y, 0])
for k in arms:
    for j in range(7):
        weak = k == arms[0] and j == 1
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q0[j], force=40 if weak else 300)
steps(720)

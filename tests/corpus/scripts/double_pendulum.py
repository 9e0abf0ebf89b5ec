import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)

s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.025, 0.025, 0.5])
b = p.createMultiBody(
    0,
    linkMasses=[1, 1],
    linkCollisionShapeIndices=[s, s],
    linkVisualShapeIndices=[-1, -1],
    linkPositions=[[0, 0, 0], [0, 0, -1]],
    linkOrientations=[[0, 0, 0, 1]] * 2,
    linkInertialFramePositions=[[0, 0, -0.5]] * 2,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
    linkParentIndices=[0, 1],
    linkJointTypes=[p.JOINT_REVOLUTE] * 2,
    linkJointAxis=[[0, 1, 0]] * 2,
)
for j, q in enumerate((2.5, 0.6)):
    p.resetJointState(b, j, q)
    p.setJointMotorControl2(b, j, p.VELOCITY_CONTROL, force=0)
steps(600)

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)

plate = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.3, 0.3, 0.05])
lift = p.createMultiBody(
    0,
    -1,
    -1,
    [0, 0, 0.5],
    linkMasses=[5],
    linkCollisionShapeIndices=[plate],
    linkVisualShapeIndices=[-1],
    linkPositions=[[0, 0, 0]],
    linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]],
    linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0],
    linkJointTypes=[p.JOINT_PRISMATIC],
    linkJointAxis=[[0, 0, 1]],
)
for i in range(1):
    s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3)
    p.createMultiBody(10, s, -1, [0, 0, 0.65 + 0.2 * i])
p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
p.setJointMotorControl2(lift, 0, p.POSITION_CONTROL, 0.2, force=294)
steps(480)

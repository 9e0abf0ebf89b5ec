import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.4, 0.02, 1])
d = p.createMultiBody(
    0,
    -1,
    -1,
    linkMasses=[10],
    linkCollisionShapeIndices=[shape],
    linkVisualShapeIndices=[-1],
    linkPositions=[[0.4, 0, 0]],
    linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]],
    linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0],
    linkJointTypes=[p.JOINT_REVOLUTE],
    linkJointAxis=[[0, 0, 1]],
)

for i in range(60):
    p.applyExternalForce(d, 0, [0, 5, 0], [0.3, 0, 0], p.LINK_FRAME)
    p.stepSimulation()

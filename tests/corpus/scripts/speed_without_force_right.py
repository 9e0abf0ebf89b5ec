import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05] * 3)
r = p.createMultiBody(
    0,
    -1,
    -1,
    linkMasses=[1],
    linkCollisionShapeIndices=[shape],
    linkVisualShapeIndices=[-1],
    linkPositions=[[0, 0, 0]],
    linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]],
    linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0],
    linkJointTypes=[p.JOINT_PRISMATIC],
    linkJointAxis=[[1, 0, 0]],
)
for i in range(60):
    p.setJointMotorControlArray(r, [0], p.VELOCITY_CONTROL, targetVelocities=[-6], forces=[100])
    steps(1)

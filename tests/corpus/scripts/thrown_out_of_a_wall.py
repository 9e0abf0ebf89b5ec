import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setTimeStep(1 / 2000)
arm = p.createCollisionShape(
    p.GEOM_BOX, halfExtents=[0.05, 0.01, 0.01], collisionFramePosition=[0.05, 0, 0]
)
p.createMultiBody(
    0,
    -1,
    -1,
    [0, 0, 1],
    linkMasses=[1],
    linkCollisionShapeIndices=[arm],
    linkVisualShapeIndices=[-1],
    linkPositions=[[0, 0, 0]],
    linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0.05, 0, 0]],
    linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0],
    linkJointTypes=[p.JOINT_REVOLUTE],
    linkJointAxis=[[0, 0, 1]],
)
p.setJointMotorControl2(0, 0, p.VELOCITY_CONTROL, force=0)
wall = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.05, 0.05])
p.createMultiBody(0, wall, -1, [0.012, 0.03, 1])
steps(120)

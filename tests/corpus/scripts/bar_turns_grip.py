import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


def box(mass, at, half):
    return p.createMultiBody(mass, p.createCollisionShape(p.GEOM_BOX, halfExtents=half), -1, at)


shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.01] * 3)
g = p.createMultiBody(
    0,
    -1,
    -1,
    [0, 0, 1],
    [0, 0, 0, 1],
    linkMasses=[0.5] * 2,
    linkCollisionShapeIndices=[shape] * 2,
    linkVisualShapeIndices=[-1] * 2,
    linkPositions=[[0, -0.035, 0], [0, 0.035, 0]],
    linkOrientations=[[0, 0, 0, 1]] * 2,
    linkInertialFramePositions=[[0] * 3] * 2,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
    linkParentIndices=[0, 0],
    linkJointTypes=[p.JOINT_PRISMATIC] * 2,
    linkJointAxis=[[0, 1, 0], [0, -1, 0]],
)
p.setPhysicsEngineParameter(numSolverIterations=200)
bar = box(0.3, [0.2, 0, 1], [0.3, 0.02, 0.02])
for j in (0, 1):
    p.changeDynamics(g, j, lateralFriction=1)
    p.setJointMotorControl2(g, j, p.VELOCITY_CONTROL, targetVelocity=0.1, force=10)
p.changeDynamics(bar, -1, lateralFriction=1)
steps(120)
p.setGravity(0, 0, -9.81)
steps(180)

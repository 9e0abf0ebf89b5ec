import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)


def box(mass, at, half=(0.05, 0.05, 0.05), mu=0.5):
    b = p.createMultiBody(mass, p.createCollisionShape(p.GEOM_BOX, halfExtents=half), -1, at)
    p.changeDynamics(b, -1, lateralFriction=mu)
    return b


p.setPhysicsEngineParameter(solverResidualThreshold=0, numSolverIterations=200)
disc = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.6, height=0.04)
t = p.createMultiBody(
    0,
    -1,
    -1,
    [0, 0, 0],
    linkMasses=[5],
    linkCollisionShapeIndices=[disc],
    linkVisualShapeIndices=[-1],
    linkPositions=[[0, 0, 0]],
    linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]],
    linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0],
    linkJointTypes=[p.JOINT_REVOLUTE],
    linkJointAxis=[[0, 0, 1]],
)
b = box(1, [0.3, 0, 0.07])
p.changeDynamics(t, 0, lateralFriction=1)
for i in range(480):
    p.setJointMotorControl2(
        t, 0, p.VELOCITY_CONTROL, targetVelocity=2 * min(1, i / 240), force=1000
    )
    p.stepSimulation()

import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")


def box(mass, at, half=(0.05, 0.05, 0.05), mu=0.5):
    b = p.createMultiBody(mass, p.createCollisionShape(p.GEOM_BOX, halfExtents=half), -1, at)
    p.changeDynamics(b, -1, lateralFriction=mu)
    return b


h = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05, 0.05, 0.05])
s = p.createMultiBody(
    0,
    -1,
    -1,
    [-0.2, 0, 0.1],
    linkMasses=[8],
    linkCollisionShapeIndices=[h],
    linkVisualShapeIndices=[-1],
    linkPositions=[[0, 0, 0]],
    linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]],
    linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0],
    linkJointTypes=[p.JOINT_PRISMATIC],
    linkJointAxis=[[1, 0, 0]],
)


def send(force):
    p.setJointMotorControl2(s, 0, p.POSITION_CONTROL, 0.5, force=force)
    steps(480)


box(1, [-0.09, 0, 0.05])
send(3)

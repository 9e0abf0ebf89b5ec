import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.05)
k = p.createMultiBody(
    0,
    basePosition=[0, 0, 2],
    linkMasses=[1],
    linkCollisionShapeIndices=[ball],
    linkVisualShapeIndices=[-1],
    linkPositions=[[0, 0, 0]],
    linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, -1]],
    linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0],
    linkJointTypes=[p.JOINT_REVOLUTE],
    linkJointAxis=[[0, 1, 0]],
)

for j in range(p.getNumJoints(k)):
    p.setJointMotorControl2(k, j, p.VELOCITY_CONTROL, force=0)
    p.resetJointState(k, j, 0.3)
steps(480)

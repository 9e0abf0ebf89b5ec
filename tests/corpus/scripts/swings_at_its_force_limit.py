"""My heavy flywheel swings to and fro around its target."""

import sys

import pybullet as p

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
wheel = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.5, height=0.1)
body = p.createMultiBody(
    0, linkMasses=[20], linkCollisionShapeIndices=[wheel], linkVisualShapeIndices=[-1],
    linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0], linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 0, 1]],
)
for _ in range(2400):
    p.setJointMotorControl2(
        body, 0, p.POSITION_CONTROL, 1.0, positionGain=0.5, velocityGain=0.2, force=2000 if FIX else 60
    )
    p.stepSimulation()
print("angle", p.getJointState(body, 0)[0], "rate", p.getJointState(body, 0)[1])

"""An arm holds a pose, two fingers hold a block, and a box falls: in PyBullet."""

import pybullet as p

p.connect(p.DIRECT)
p.setTimeStep(0.002)
p.setGravity(0, 0, -9.81)


def box(x: float, y: float, z: float) -> int:
    """Return a shape, by half of its sides [m]."""
    return p.createCollisionShape(p.GEOM_BOX, halfExtents=[x, y, z])


def jointed(base: list[float], link: list[float], shape: int, mass: float, kind: int) -> int:
    """Return a body that hangs on the world by one joint about or along y."""
    centre = [0.2, 0, 0] if kind == p.JOINT_REVOLUTE else [0, 0, 0]
    return p.createMultiBody(
        basePosition=base,
        linkMasses=[mass],
        linkCollisionShapeIndices=[shape],
        linkVisualShapeIndices=[-1],
        linkPositions=[link],
        linkOrientations=[[0, 0, 0, 1]],
        linkInertialFramePositions=[centre],
        linkInertialFrameOrientations=[[0, 0, 0, 1]],
        linkParentIndices=[0],
        linkJointTypes=[kind],
        linkJointAxis=[[0, 1, 0]],
    )


p.createMultiBody(baseCollisionShapeIndex=p.createCollisionShape(p.GEOM_PLANE))
p.createMultiBody(1, box(0.1, 0.1, 0.1), basePosition=[0, 0, 0.3])
p.createMultiBody(0.5, box(0.03, 0.05, 0.03), basePosition=[1, 0, 1])
left = jointed([1, -0.061, 1], [0, 0, 0], box(0.02, 0.01, 0.03), 0.2, p.JOINT_PRISMATIC)
right = jointed([1, 0.061, 1], [0, 0, 0], box(0.02, 0.01, 0.03), 0.2, p.JOINT_PRISMATIC)
arm = jointed([-1, 0, 1], [0, 0, 0], -1, 1.0, p.JOINT_REVOLUTE)
for finger in (left, right):
    p.changeDynamics(finger, 0, lateralFriction=1)
    p.setJointMotorControl2(finger, 0, p.VELOCITY_CONTROL, force=0)
p.setJointMotorControl2(arm, 0, p.POSITION_CONTROL, targetPosition=0.5, force=100)
for _ in range(1000):
    p.setJointMotorControl2(left, 0, p.TORQUE_CONTROL, force=25)
    p.setJointMotorControl2(right, 0, p.TORQUE_CONTROL, force=-25)
    p.stepSimulation()

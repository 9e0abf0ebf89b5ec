"""An attached part that jerks."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
base = p.loadURDF("cube.urdf", [0, 0, 0.5])
part = p.loadURDF("cube_small.urdf", [0, 0, 1.5])
p.createConstraint(base, -1, part, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0.5], [0, 0, 0])
for _ in range(240):
    p.stepSimulation()

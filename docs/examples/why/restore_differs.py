"""A state that is restored, and runs differently."""

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
cubes = [p.loadURDF("cube_small.urdf", [0, 0.02 * n, 0.2 * n + 0.2]) for n in range(6)]
for _ in range(120):
    p.stepSimulation()
state = p.saveState()
for _ in range(120):
    p.stepSimulation()
p.restoreState(state)
for _ in range(120):
    p.stepSimulation()

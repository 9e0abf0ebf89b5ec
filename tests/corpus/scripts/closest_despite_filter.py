"""setCollisionFilterPair switched the pair off, and getClosestPoints still reports it."""

import sys

import pybullet as p

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
a = p.createMultiBody(1, shape, basePosition=[0, 0, 0])
b = p.createMultiBody(1, shape, basePosition=[0.15, 0, 0])
p.setCollisionFilterPair(a, b, -1, -1, 0)
for _ in range(10):
    p.stepSimulation()
near = p.getContactPoints(a, b) if FIX else p.getClosestPoints(a, b, 0.01)
print("points", len(near), [round(c[8], 3) for c in near])

"""The ball does not lie in the bowl, it rests on top of it."""

import sys

import mujoco
import numpy as np

FIX = "fix" in sys.argv
# a square bowl: a floor and four walls that lean outwards
corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
low, high = np.c_[corners * 0.1, np.zeros(4)], np.c_[corners * 0.2, np.full(4, 0.15)]
under, over = np.c_[corners * 0.12, np.full(4, -0.02)], np.c_[corners * 0.22, np.full(4, 0.15)]
vertices = np.vstack([low, high, under, over])
faces = [(0, 1, 2), (0, 2, 3), (8, 10, 9), (8, 11, 10)]
for a in range(4):
    b = (a + 1) % 4
    faces += [(a, 4 + b, b), (a, 4 + a, 4 + b), (8 + a, 8 + b, 12 + b), (8 + a, 12 + b, 12 + a)]
    faces += [(4 + a, 12 + a, 12 + b), (4 + a, 12 + b, 4 + b)]
parts = [range(16)] if not FIX else [[0, 1, 2, 3, 8, 9, 10, 11]] + [
    [a, (a + 1) % 4, 4 + a, 4 + (a + 1) % 4, 8 + a, 8 + (a + 1) % 4, 12 + a, 12 + (a + 1) % 4] for a in range(4)]
spec = mujoco.MjSpec()
for n, part in enumerate(parts):
    mesh = spec.add_mesh(name=f"bowl{n}", uservert=vertices[list(part)].ravel())
    if not FIX:
        mesh.userface = np.array(faces).ravel()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"bowl{n}")
ball = spec.worldbody.add_body(name="ball", pos=[0, 0, 0.3])
ball.add_freejoint()
ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0, 0], mass=0.2)
model = spec.compile()
data = mujoco.MjData(model)
for _ in range(1000):
    mujoco.mj_step(model, data)
print("ball at:", data.qpos[2])

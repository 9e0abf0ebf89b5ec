"""A ball that rests on the air of a tray."""

from pathlib import Path

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
HALF, HEIGHT = 0.2, 0.2
corners = [
    (x, y, z)
    for z in (0, HEIGHT)
    for x, y in ((-HALF, -HALF), (HALF, -HALF), (HALF, HALF), (-HALF, HALF))
]
faces = ["1 4 3 2", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8"]
lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {face}" for face in faces]
Path("tray.obj").write_text("\n".join(lines))
tray = p.createMultiBody(0, p.createCollisionShape(p.GEOM_MESH, fileName="tray.obj"))
ball = p.createMultiBody(0.1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.05), -1, [0, 0, 0.5])
for _ in range(240):
    p.stepSimulation()

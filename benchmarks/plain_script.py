"""A plain script: drop, photograph, compare, and write a gif with matplotlib.

The baseline for `drop run`: 240 steps, 41 TinyRenderer frames, FuncAnimation and PillowWriter.
"""

import matplotlib.pyplot as plt
import numpy as np
import pybullet as p
import pybullet_data
from matplotlib.animation import FuncAnimation, PillowWriter

STEPS, EVERY = 240, 6

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
box = p.loadURDF("cube_small.urdf", [0, 0, 1])
view = p.computeViewMatrixFromYawPitchRoll([0, 0, 0.5], 2.0, 45, -25, 0, 2)
projection = p.computeProjectionMatrixFOV(60, 480 / 360, 0.1, 10.0)

heights, frames = [], []
for step in range(STEPS + 1):
    heights.append(p.getBasePositionAndOrientation(box)[0][2])
    if step % EVERY == 0:
        image = p.getCameraImage(480, 360, view, projection, renderer=p.ER_TINY_RENDERER)
        frames.append(np.reshape(image[2], (360, 480, 4))[:, :, :3].astype(np.uint8))
    p.stepSimulation()
p.disconnect()

theory = 1.0 - 9.81 / 2 * (72 / 240) ** 2
print(f"0.3 s: {heights[72]:.4f} m, theory {theory:.4f} m, {heights[72] - theory:+.4f} m")

figure, axes = plt.subplots(figsize=(4.8, 3.6))
axes.axis("off")
picture = axes.imshow(frames[0])


def show(number):  # noqa: ANN001, ANN201, D103
    picture.set_data(frames[number])
    return (picture,)


FuncAnimation(figure, show, frames=len(frames)).save("fall.gif", writer=PillowWriter(fps=20))

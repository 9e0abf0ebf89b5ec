"""My box should stand upright but starts tipped on its side. I give it a yaw of 30 degrees."""

import sys

import mujoco
import numpy as np

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><geom type="plane" size="3 3 .1"/>
  <body name="post" pos="0 0 .31"><freejoint/><geom type="box" size=".05 .1 .3" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
mujoco.mj_resetData(model, data)
q = np.array([0, 0, np.sin(np.pi / 12), np.cos(np.pi / 12)])  # x, y, z, w, as SciPy has it
data.qpos[3:7] = np.roll(q, 1) if FIX else q
for _ in range(1000):
    mujoco.mj_step(model, data)
print("height", data.qpos[2])

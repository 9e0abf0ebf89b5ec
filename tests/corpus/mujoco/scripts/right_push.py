"""A box is pushed for a tenth of a second and comes to rest."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>
  <body name="box" pos="0 0 0.1"><freejoint/><geom name="box" type="box" size="0.1 0.1 0.1" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for k in range(1000):
    data.xfrc_applied[1, 0] = 15 if 100 <= k < 150 else 0
    mujoco.mj_step(model, data)
print("at", data.qpos[0], "speed", data.qvel[0])

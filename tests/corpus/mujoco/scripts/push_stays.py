"""I push the box for one step, and it never stops."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="50 50 1" friction="0.3"/>
  <body name="box" pos="0 0 0.1"><freejoint/><geom name="box" type="box" size="0.1 0.1 0.1" mass="1" friction="0.3"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for k in range(500):
    if k == 100:
        data.xfrc_applied[1, 0] = 8
    if k == 101 and FIX:
        data.xfrc_applied[:] = 0
    mujoco.mj_step(model, data)
print("at", data.qpos[0], "speed", data.qvel[0])

"""The wind that I set up has no effect."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><geom type="plane" size="9 9 1"/>
  <body name="ball" pos="0 0 0.1"><freejoint/><geom size="0.1" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
if FIX:
    mujoco.mj_resetData(model, data)
data.xfrc_applied[1, 0] = 1
if not FIX:
    mujoco.mj_resetData(model, data)
for _ in range(500):
    mujoco.mj_step(model, data)
print("ball at:", data.qpos[:3])

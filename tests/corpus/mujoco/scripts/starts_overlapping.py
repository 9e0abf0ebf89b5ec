"""The boxes fly apart at the start."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>
  <body name="low" pos="0 0 0.1"><freejoint/><geom name="low" type="box" size="0.1 0.1 0.1" mass="1"/></body>
  <body name="high" pos="0 0 {z}"><freejoint/><geom name="high" type="box" size="0.1 0.1 0.1" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(z=0.31 if FIX else 0.2))
data = mujoco.MjData(model)
top = 0.0
for _ in range(1000):
    mujoco.mj_step(model, data)
    top = max(top, data.qpos[9])
print("highest:", top)

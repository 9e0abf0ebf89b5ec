"""The ball falls through the tray."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>
  <body name="tray" pos="0 0 0.5"><geom name="tray" type="box" size="0.3 0.3 0.02" contype="{bits}" conaffinity="{bits}"/></body>
  <body name="ball" pos="0 0 1"><freejoint/><geom name="ball" type="sphere" size="0.05" mass="0.2"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(bits=1 if FIX else 2))
data = mujoco.MjData(model)
for _ in range(1000):
    mujoco.mj_step(model, data)
print("height:", data.qpos[2])

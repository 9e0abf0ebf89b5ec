"""My elastic ball bounces a little higher each time."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="{dt}"/><worldbody><geom name="floor" type="plane" size="5 5 1" solref="-20000 0" priority="1"/>
  <body name="ball" pos="0 0 1"><freejoint/><geom type="sphere" size="0.05" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(dt="0.0005" if FIX else "0.005"))
data = mujoco.MjData(model)
top, tops = 0.0, []
while data.time < 5:
    v = data.qvel[2]
    mujoco.mj_step(model, data)
    if v > 0 >= data.qvel[2]:
        tops.append(round(float(data.qpos[2]), 3))
print("tops:", tops)

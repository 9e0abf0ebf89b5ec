"""I hold the box in place and let it go, and it shoots down as if it were thrown."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><geom type="plane" size="5 5 1"/>
  <body name="box" pos="0 0 3"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for step in range(480):
    if step < 400:
        data.qpos[:] = 0, 0, 3, 1, 0, 0, 0
        if FIX:
            data.qvel[:] = 0
    mujoco.mj_step(model, data)
print("height:", data.qpos[2], "speed:", data.qvel[2])

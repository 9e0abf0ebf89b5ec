"""The box hangs in the air."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option><flag gravity="{gravity}"/></option><worldbody><geom type="plane" size="5 5 1"/>
  <body name="box" pos="0 0 0.5"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(gravity="enable" if FIX else "disable"))
data = mujoco.MjData(model)
for _ in range(500):
    mujoco.mj_step(model, data)
print("height:", data.qpos[2])

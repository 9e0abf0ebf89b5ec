"""The box sinks into the table."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="table" type="plane" size="2 2 1" solref="{solref}" priority="1"/>
  <body name="box" pos="0 0 0.1"><freejoint/><geom name="box" type="box" size="0.1 0.1 0.1" mass="20"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(solref="0.02 1" if FIX else "0.3 1"))
data = mujoco.MjData(model)
for _ in range(2500):
    mujoco.mj_step(model, data)
print("sunk by mm:", (0.1 - data.qpos[2]) * 1e3)

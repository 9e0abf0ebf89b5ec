"""The box does not stay on the slope."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="ramp" type="plane" size="5 5 1" euler="0 20 0" friction="{mu}"/>
  <body name="box" pos="0 0 0.12" euler="0 20 0"><freejoint/><geom name="box" type="box" size="0.1 0.1 0.1" mass="1" friction="{mu}"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(mu=0.8 if FIX else 0.2))
data = mujoco.MjData(model)
for _ in range(500):
    mujoco.mj_step(model, data)
print("moved:", data.qpos[:3])

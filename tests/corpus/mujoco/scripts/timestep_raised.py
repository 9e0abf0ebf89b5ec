"""I save time with a larger timestep once everything has settled, and the press goes into the plate."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.001"/><worldbody>
  <geom name="plate" type="plane" size="5 5 1" solref="0.002 1" priority="1"/>
  <body name="press" pos="0 0 0.15"><joint name="slide" type="slide" axis="0 0 1"/>
    <geom type="box" size="0.1 0.1 0.1" mass="2"/></body></worldbody>
<actuator><motor name="push" joint="slide"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
data.ctrl[0] = -1000
for _ in range(1000):
    mujoco.mj_step(model, data)
print("inside by mm:", -(data.qpos[0] + 0.05) * 1e3)
if not FIX:
    model.opt.timestep = 0.01
for _ in range(500):
    mujoco.mj_step(model, data)
print("inside by mm:", -(data.qpos[0] + 0.05) * 1e3)

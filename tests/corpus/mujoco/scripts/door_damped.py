"""The door opener pushes with 3 N m and the door hardly opens."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="door" pos="0 0 1"><joint name="door" axis="0 0 1" damping="{damping}"/>
    <geom type="box" size="0.4 0.02 0.9" pos="0.4 0 0" mass="8"/></body></worldbody>
<actuator><motor name="opener" joint="door" ctrlrange="-5 5"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(damping=0.5 if FIX else 60))
data = mujoco.MjData(model)
while data.time < 1.5:
    data.ctrl[0] = 3.0
    mujoco.mj_step(model, data)
print("angle:", data.qpos[0])

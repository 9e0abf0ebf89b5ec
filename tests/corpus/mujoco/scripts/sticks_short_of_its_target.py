"""The pan axis stops short of where I send it, although nothing touches it and gravity is off its axis."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody>
  <body name="head" pos="0 0 1"><joint name="pan" axis="0 0 1" damping="0.2" frictionloss="{loss}"/>
    <geom type="box" size="0.1 0.06 0.06" mass="1"/></body></worldbody>
<actuator><position joint="pan" kp="5"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(loss=0.01 if FIX else 4))
data = mujoco.MjData(model)
for _ in range(500):
    data.ctrl[0] = 0.6
    mujoco.mj_step(model, data)
print("angle:", data.qpos[0])

"""My pusher goes two centimetres into the wall."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="wall" type="box" size="0.05 0.5 0.5" pos="0.5 0 0.5" solimp="{solimp}" priority="1"/>
  <body name="pusher" pos="0.3 0 0.5"><joint name="push" type="slide" axis="1 0 0" damping="20"/><geom name="pusher" type="box" size="0.05 0.05 0.05" mass="1"/></body></worldbody>
<actuator><motor name="push" joint="push"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(
    XML.format(solimp="0.9 0.95 0.001" if FIX else "0 0.05 0.05")
)
data = mujoco.MjData(model)
for _ in range(2500):
    data.ctrl[:] = 200
    mujoco.mj_step(model, data)
print("inside by mm:", (data.qpos[0] - 0.1) * 1e3)

"""The block slips out of the gripper."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"{opt}/><worldbody>
  <body name="left" pos="0 -0.061 1"><joint name="left" type="slide" axis="0 1 0" damping="50"/><geom name="left_pad" type="box" size="0.02 0.01 0.03" mass="0.2" friction="1"/></body>
  <body name="right" pos="0 0.061 1"><joint name="right" type="slide" axis="0 -1 0" damping="50"/><geom name="right_pad" type="box" size="0.02 0.01 0.03" mass="0.2" friction="1"/></body>
  <body name="block" pos="0 0 1"><freejoint/><geom name="block" type="box" size="0.03 0.05 0.03" mass="0.5" friction="1"/></body></worldbody>
<actuator><motor name="left" joint="left"/><motor name="right" joint="right"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(opt=""))
data = mujoco.MjData(model)
for _ in range(500):
    data.ctrl[:] = 20 if FIX else 1.5
    mujoco.mj_step(model, data)
print("block fell by mm:", (1 - data.body("block").xpos[2]) * 1e3)

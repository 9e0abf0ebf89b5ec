"""I drive the wheel by qfrc_applied, and after the reset it stands still."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody>
  <body name="wheel" pos="0 0 1"><joint name="axle" axis="0 0 1" damping="0.02"/>
    <geom type="cylinder" size="0.1 0.02" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
data.qfrc_applied[0] = 0.1
for step in range(1000):
    if step == 500:
        mujoco.mj_resetData(model, data)
        if FIX:
            data.qfrc_applied[0] = 0.1
    mujoco.mj_step(model, data)
print("rate:", data.qvel[0])

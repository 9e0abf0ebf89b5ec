"""I kick the wheel once, and it spins faster and faster."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><body name="wheel" pos="0 0 1"><joint name="wheel" axis="0 1 0" damping="0.01"/>
  <geom type="cylinder" size="0.2 0.02" euler="90 0 0" mass="1" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for k in range(500):
    if k == 50:
        data.qfrc_applied[0] = 0.5
    if k == 51 and FIX:
        data.qfrc_applied[0] = 0
    mujoco.mj_step(model, data)
print("rate:", data.qvel[0])

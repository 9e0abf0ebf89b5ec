"""The slider stops at 0.5, though I send it to 0.8."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option gravity="0 0 0"/><worldbody><body name="slider">
  <joint name="rail" type="slide" axis="1 0 0" damping="5"/>
  <geom type="box" size=".1 .05 .05" mass="1"/></body></worldbody>
<actuator><position name="servo" joint="rail" kp="100" ctrlrange="RANGE"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.replace("RANGE", "-1 1" if FIX else "-.5 .5"))
data = mujoco.MjData(model)
for _ in range(1000):
    data.ctrl[0] = 0.8
    mujoco.mj_step(model, data)
print("off:", data.qpos - data.ctrl)

"""The arm falls as if it had no motors."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option><flag actuation="{actuation}"/></option><worldbody>
  <body name="arm" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="1"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="2"/></body></worldbody>
<actuator><position joint="shoulder" kp="2000" kv="20"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(actuation="enable" if FIX else "disable"))
data = mujoco.MjData(model)
data.ctrl[0] = 0.3
for _ in range(1000):
    mujoco.mj_step(model, data)
print("angle:", data.qpos[0])

"""The first step after my own reset is wild."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="5" armature="0.1"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04" mass="3" contype="0" conaffinity="0"/>
    <body name="lower" pos="0.4 0 0"><joint name="elbow" axis="0 1 0" damping="5" armature="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="2" contype="0" conaffinity="0"/>
    </body></body></worldbody>
<actuator><motor name="shoulder" joint="shoulder"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
mujoco.mj_step1(model, data)
data.qpos[:] = 1.2, -2.0
if FIX:
    mujoco.mj_step1(model, data)
for _ in range(200):
    mujoco.mj_step2(model, data)
    mujoco.mj_step1(model, data)
print("ends at", data.qpos)

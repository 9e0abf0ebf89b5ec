"""The arm holds its pose in the first episode and hangs down in the second."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody>
  <body name="arm" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="2"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position joint="shoulder" kp="400"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
data.ctrl[0] = -0.8
for episode in range(2):
    mujoco.mj_resetData(model, data) if episode or FIX else None
    if FIX:
        data.ctrl[0] = -0.8
    for _ in range(600):
        mujoco.mj_step(model, data)
    print("episode", episode, "angle:", data.qpos[0])

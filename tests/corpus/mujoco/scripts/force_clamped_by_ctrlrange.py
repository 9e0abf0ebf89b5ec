"""My own PD controller computes the right torque, and the arm still sags."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody>
  <body name="arm" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="0.5"/>
    <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="2" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor name="shoulder" joint="shoulder" ctrlrange="-{limit} {limit}" ctrllimited="true"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(limit=20 if FIX else 1))
data = mujoco.MjData(model)
for _ in range(1500):
    data.ctrl[0] = 300 * (-0.4 - data.qpos[0]) - 15 * data.qvel[0] + data.qfrc_bias[0]
    mujoco.mj_step(model, data)
print("angle:", data.qpos[0])

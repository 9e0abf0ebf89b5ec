"""The motor gives its torque and the link does not turn."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody>
  <body name="link" pos="0 0 1"><joint name="yaw" axis="0 0 1" damping="0.1" frictionloss="{loss}"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1"/></body></worldbody>
<actuator><motor name="yaw" joint="yaw"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(loss=0.05 if FIX else 1.5))
data = mujoco.MjData(model)
for _ in range(500):
    data.ctrl[0] = 1.0
    mujoco.mj_step(model, data)
print("angle:", data.qpos[0])

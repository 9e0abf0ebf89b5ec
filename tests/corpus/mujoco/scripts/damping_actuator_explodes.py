"""I damp my servo with a velocity actuator, and the more I damp it, the worse it gets."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body><joint name="pin" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="1"/></body></worldbody>
<actuator><position name="p" joint="pin" kp="100"/><velocity name="d" joint="pin" kv="{kv}"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(kv=10 if FIX else 100))
data = mujoco.MjData(model)
data.ctrl[0] = 0.5
fastest = 0.0
for _ in range(300):
    mujoco.mj_step(model, data)
    fastest = max(fastest, abs(data.qvel[0]))
print("fastest:", fastest, "angle:", data.qpos[0])

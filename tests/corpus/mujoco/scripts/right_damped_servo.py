"""A position and a velocity actuator together are a servo: kp of one, the other's kv damps it."""

import mujoco

XML = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body><joint name="pin" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="1"/></body></worldbody>
<actuator><position name="p" joint="pin" kp="100"/><velocity name="d" joint="pin" kv="10"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(3000):
    data.ctrl[0] = 0.2 * data.time
    mujoco.mj_step(model, data)
print("behind:", data.ctrl[0] - data.qpos[0], "rate:", data.qvel[0])

"""I switched gravity compensation on for the whole arm, and it sags all the same."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody>
  <body name="upper" pos="0 0 1" {compensated}><joint name="shoulder" axis="0 1 0" damping="1"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="2"/>
    <body name="fore" pos="0.3 0 0" {compensated}><joint name="elbow" axis="0 1 0" damping="1"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.025" mass="1"/></body></body></worldbody>
<actuator><position joint="shoulder" kp="60" kv="6"/><position joint="elbow" kp="30" kv="3"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(compensated='gravcomp="1"' if FIX else ""))
data = mujoco.MjData(model)
model.body_gravcomp[1:] = 1.0
for _ in range(2000):
    mujoco.mj_step(model, data)
print("angles:", data.qpos, "compensated:", data.qfrc_gravcomp)

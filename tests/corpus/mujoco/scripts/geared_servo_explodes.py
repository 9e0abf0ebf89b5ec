"""With a gear of 50 the shoulder blows up, though its kp is a modest 150."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody>
  <body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 0 1" damping="4"/>
    <geom type="capsule" fromto="0 0 0 0.374 0 0" size="0.03" mass="0.799"/>
    <body name="lower" pos="0.374 0 0"><joint name="elbow" axis="0 0 1" damping="4"/>
      <geom type="capsule" fromto="0.04 0 0 0.297 0 0" size="0.025" mass="0.436"/></body></body></worldbody>
<actuator><position name="geared" joint="shoulder" kp="{kp}" gear="50"/>
  <position name="elbow" joint="elbow" kp="60"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(kp=15 if FIX else 150))
data = mujoco.MjData(model)
resets, before = 0, 0.0
for _ in range(2000):
    data.ctrl[:] = 0.922, 0.3
    mujoco.mj_step(model, data)
    resets, before = resets + (data.time < before), data.time
print("resets:", resets, "shoulder:", data.qpos[0])

"""A leg whose inner tube slides into the outer one."""

import mujoco

XML = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body name="hip" pos="0 0 1"><joint name="hip" axis="0 1 0" damping="1" stiffness="50"/>
    <geom name="outer" type="box" pos="0 0 -0.15" size="0.05 0.05 0.15" mass="1"/>
    <body name="inner" pos="0 0 -0.42"><joint name="knee" type="slide" axis="0 0 1" range="-0.05 0.25" damping="5"/>
      <geom name="inner" type="box" pos="0 0 -0.15" size="0.03 0.03 0.14" mass="0.5"/></body></body></worldbody>
<actuator><position name="knee" joint="knee" kp="2000" kv="60"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for step in range(1000):
    data.ctrl[0] = 0.2 if step > 200 else 0.0
    mujoco.mj_step(model, data)
print("knee:", data.qpos[1])

"""An arm holds a pose, two fingers hold a block, and a box falls: in MuJoCo."""

import mujoco

XML = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="5 5 1" friction="0.5"/>
    <body name="box" pos="0 0 0.3">
      <freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1" friction="0.5"/>
    </body>
    <body name="block" pos="1 0 1">
      <freejoint/><geom type="box" size="0.03 0.05 0.03" mass="0.5" friction="0.5"/>
    </body>
    <body name="left" pos="1 -0.061 1">
      <joint name="left" type="slide" axis="0 1 0"/>
      <geom type="box" size="0.02 0.01 0.03" mass="0.2"/>
    </body>
    <body name="right" pos="1 0.061 1">
      <joint name="right" type="slide" axis="0 1 0"/>
      <geom type="box" size="0.02 0.01 0.03" mass="0.2"/>
    </body>
    <body name="arm" pos="-1 0 1">
      <joint name="shoulder" axis="0 1 0"/>
      <inertial pos="0.2 0 0" mass="1" diaginertia="0.001 0.01 0.01"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="left" joint="left"/>
    <motor name="right" joint="right"/>
    <position name="servo" joint="shoulder" kp="100" dampratio="1"/>
  </actuator>
</mujoco>
"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(1000):
    data.ctrl[:] = 25, -25, 0.5
    mujoco.mj_step(model, data)

"""Hold a block between two pads of MuJoCo, and ask why it creeps out of the grip."""

import mujoco

model = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <body name="left" pos="0 -0.061 1">
      <joint name="left" type="slide" axis="0 1 0" damping="50"/>
      <geom type="box" size="0.02 0.01 0.03" mass="0.2"/>
    </body>
    <body name="right" pos="0 0.061 1">
      <joint name="right" type="slide" axis="0 -1 0" damping="50"/>
      <geom type="box" size="0.02 0.01 0.03" mass="0.2"/>
    </body>
    <body name="block" pos="0 0 1">
      <freejoint/>
      <geom type="box" size="0.03 0.05 0.03" mass="0.5"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="left" joint="left"/>
    <motor name="right" joint="right"/>
  </actuator>
</mujoco>
""")
data = mujoco.MjData(model)
for _ in range(2000):
    data.ctrl[:] = 25
    mujoco.mj_step(model, data)

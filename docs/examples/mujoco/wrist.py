"""Give a light wrist of MuJoCo the gain of a heavy one, and ask why it explodes."""

import mujoco

model = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <body name="hand" pos="0 0 1">
      <joint name="wrist" axis="1 0 0"/>
      <geom type="capsule" fromto="0 0 0 0.05 0 0" size="0.01" mass="0.05"/>
    </body>
  </worldbody>
  <actuator>
    <position name="wrist" joint="wrist" kp="20"/>
  </actuator>
</mujoco>
""")
data = mujoco.MjData(model)
for _ in range(1000):
    data.ctrl[:] = 0.1
    mujoco.mj_step(model, data)

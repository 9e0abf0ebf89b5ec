"""Send an arm of MuJoCo to a pose that its servos do not reach, and ask why."""

import mujoco

model = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <geom type="plane" size="2 2 0.1"/>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" damping="2"/>
      <geom type="capsule" size="0.04" fromto="0 0 0 0.4 0 0" mass="2"/>
      <body name="lower" pos="0.4 0 0">
        <joint name="elbow" axis="0 1 0" damping="1"/>
        <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="100"/>
    <position name="elbow" joint="elbow" kp="100" forcerange="-1 1"/>
  </actuator>
</mujoco>
""")
data = mujoco.MjData(model)
for _ in range(3000):
    data.ctrl[:] = 0, -0.5
    mujoco.mj_step(model, data)

"""A pendulum of MuJoCo that a motor drives for a second."""

import mujoco

MODEL = """
<mujoco>
  <worldbody>
    <body name="rod" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator>
</mujoco>
"""
m = mujoco.MjModel.from_xml_string(MODEL)
d = mujoco.MjData(m)
for step in range(500):
    d.ctrl[0] = 0.3 if step < 100 else 0.0
    mujoco.mj_step(m, d)

"""Why does my pendulum stop although its joint has no damping?"""

import mujoco

XML = """
<mujoco>
  <option timestep="0.002" viscosity="0.5"/>
  <worldbody>
    <body name="pendulum" pos="0 0 1">
      <joint name="pivot" type="hinge" axis="0 1 0" damping="0"/>
      <geom name="bob" type="capsule" fromto="0 0 0 0 0 -0.5" size="0.05" mass="1" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
</mujoco>
"""
m = mujoco.MjModel.from_xml_string(XML)
d = mujoco.MjData(m)
d.qpos[0] = 1.0
for _ in range(2000):
    mujoco.mj_step(m, d)
print(d.qpos)

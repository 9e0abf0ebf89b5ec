"""The rover should start with its nose along +x and drive that way, but it goes backwards.

I reset its pose with the identity quaternion, [0, 0, 0, 1].
"""

import sys

import mujoco
import numpy as np

FIX = "fix" in sys.argv

m = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 0.1" friction="0.05"/>
    <body name="rover" pos="0 0 0.1">
      <freejoint/>
      <geom name="hull" type="box" size="0.3 0.15 0.1" mass="4" friction="0.05"/>
      <geom name="nose" type="box" pos="0.35 0 0" size="0.05 0.05 0.05" mass="0.1"/>
      <site name="thruster" pos="-0.3 0 0"/>
    </body>
  </worldbody>
  <actuator>
    <general name="thrust" site="thruster" gear="1 0 0 0 0 0"/>
  </actuator>
</mujoco>
""")
d = mujoco.MjData(m)

mujoco.mj_resetData(m, d)
d.qpos[:3] = [0, 0, 0.1]
d.qpos[3:7] = [1, 0, 0, 0] if FIX else [0, 0, 0, 1]
d.ctrl[0] = 8.0
while d.time < 1.0:
    mujoco.mj_step(m, d)

print("x after 1 s:", np.round(d.qpos[0], 3), "m")

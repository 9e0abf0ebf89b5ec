"""Domain randomisation: the payload's mass is drawn anew for each episode, from 0.8 to 1.4 kg.

Is it all right to write body_mass?
"""

import mujoco
import numpy as np

m = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body name="payload" pos="0 0 0.12">
      <freejoint/>
      <geom type="box" size="0.1 0.1 0.1" mass="1"/>
    </body>
  </worldbody>
</mujoco>
""")
d = mujoco.MjData(m)
rng = np.random.default_rng(0)

for episode in range(4):
    mujoco.mj_resetData(m, d)
    m.body_mass[1] = rng.uniform(0.8, 1.4)
    for _ in range(200):
        mujoco.mj_step(m, d)
    print(episode, np.round(m.body_mass[1], 3), "kg rests at", np.round(d.qpos[2], 4), "m")

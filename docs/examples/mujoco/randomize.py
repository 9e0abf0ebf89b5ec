"""Push a puck with a randomized model, and ask why two seeds do not agree."""

import argparse

import mujoco
import numpy as np

parser = argparse.ArgumentParser()
parser.add_argument("--seed", type=int, default=1)
rng = np.random.default_rng(parser.parse_args().seed)

model = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <geom name="table" type="plane" size="2 2 0.1"/>
    <body name="pusher" pos="0 0 0.05">
      <joint name="push" type="slide" axis="1 0 0" damping="5" range="0 0.3" limited="true"/>
      <geom name="pusher" type="box" size="0.02 0.1 0.03"/>
    </body>
    <body name="puck" pos="0.08 0 0.03">
      <freejoint/>
      <geom name="puck" type="cylinder" size="0.05 0.03" density="500"/>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="push"/></actuator>
</mujoco>
""")
model.geom("puck").friction[0] = rng.uniform(0.2, 0.9)
model.joint("push").damping *= rng.uniform(0.9, 1.1)
model.joint("push").armature += rng.uniform(0, 0.1)
model.geom("pusher").friction[0] = rng.uniform(0.2, 0.9)

data = mujoco.MjData(model)
for _ in range(500):
    data.ctrl[0] = 8.0 if data.time < 0.3 else 0.0
    mujoco.mj_step(model, data)
print(f"the puck is at {data.body('puck').xpos[0]:.3f} m")

"""An arm rests on its stop, with payloads of 90 to 130 g. Are these edits all right?"""

import math

import mujoco

XML = """<mujoco><option timestep="0.002"/><worldbody><body name="arm" pos="0 0 1">
  <joint name="shoulder" axis="0 1 0" range="-30 30" damping="0.5"/>
  <geom type="capsule" size="0.03" fromto="0 0 0 0.5 0 0" mass="1"/>
  <body name="payload" pos="0.5 0 0"><geom type="sphere" size="0.05" mass="0.1"/></body></body>
  </worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
payload = model.body("payload").id
for grams in (100, 90, 130, 110):
    model.body_mass[payload] = 1e-3 * grams
    for _ in range(500):
        mujoco.mj_step(model, data)
    print("beyond the stop by degrees:", math.degrees(data.qpos[0]) - 30)

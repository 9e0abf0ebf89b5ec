"""The mass of each episode is another one, set as it should be."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>
  <body name="box" pos="0 0 0.3"><freejoint/><geom name="box" type="box" size="0.1 0.1 0.1" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for mass in (0.5, 1.0, 4.0):
    model.body_inertia[1] *= mass / model.body_mass[1]
    model.body_mass[1] = mass
    mujoco.mj_setConst(model, mujoco.MjData(model))
    mujoco.mj_resetData(model, data)
    for _ in range(400):
        mujoco.mj_step(model, data)
print("height:", data.qpos[2])

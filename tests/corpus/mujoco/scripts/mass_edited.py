"""I randomise the mass, and the box sinks into the floor."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>
  <body name="box" pos="0 0 0.1"><freejoint/><geom name="box" type="box" size="0.1 0.1 0.1" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for k in range(1500):
    if k == 500:
        model.body_mass[1] *= 20
        model.body_inertia[1] *= 20
        if FIX:
            mujoco.mj_setConst(model, mujoco.MjData(model))
    mujoco.mj_step(model, data)
print("sunk by mm:", (0.1 - data.qpos[2]) * 1e3)

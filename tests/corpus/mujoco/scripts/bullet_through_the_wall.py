"""My projectile flies through the wall as if it were not there."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="{dt}"/><worldbody><geom name="floor" type="plane" size="9 9 1"/>
  <geom name="wall" type="box" size="0.02 1 1" solref="0.001 1" priority="1" pos="2 0 1"/>
  <body name="ball" pos="0.13 0 1"><freejoint/><geom type="sphere" size="0.03" mass="0.05"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(dt="0.0005" if FIX else "0.01"))
data = mujoco.MjData(model)
data.qvel[0] = 15
while data.time < 0.4:
    mujoco.mj_step(model, data)
print("ball at x =", data.qpos[0])

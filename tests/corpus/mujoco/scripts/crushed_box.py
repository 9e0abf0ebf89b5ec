"""I put a heavy block on a light box, and the box is pressed into the floor."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>
  <body name="carton" pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="{light}"/></body>
  <body name="block" pos="0 0 0.3"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="200"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(light=50 if FIX else 0.5))
data = mujoco.MjData(model)
for _ in range(1500):
    mujoco.mj_step(model, data)
print("carton sunk by mm:", (0.1 - data.qpos[2]) * 1e3, "block above carton by", data.qpos[9] - data.qpos[2])

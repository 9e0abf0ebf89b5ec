"""The two boxes pass through each other since I copied the contact section."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>
  <body name="low" pos="0 0 0.1"><freejoint/><geom name="low" type="box" size="0.1 0.1 0.1" mass="1"/></body>
  <body name="high" pos="0 0 0.5"><freejoint/><geom name="high" type="box" size="0.1 0.1 0.1" mass="1"/></body></worldbody>
  {contact}</mujoco>"""
model = mujoco.MjModel.from_xml_string(
    XML.format(contact="" if FIX else '<contact><exclude body1="low" body2="high"/></contact>')
)
data = mujoco.MjData(model)
for _ in range(1000):
    mujoco.mj_step(model, data)
print("heights:", data.qpos[2], data.qpos[9])

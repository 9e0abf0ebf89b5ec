"""I push the block and it neither falls nor moves."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><geom type="plane" size="5 5 1"/>
  <body name="block" pos="0 0 0.5">{joint}<geom type="box" size="0.1 0.1 0.1" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(joint="<freejoint/>" if FIX else ""))
data = mujoco.MjData(model)
block = model.body("block").id
for _ in range(500):
    data.xfrc_applied[block, 0] = 15.0
    mujoco.mj_step(model, data)
print("block at:", data.xpos[block])

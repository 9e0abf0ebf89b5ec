"""The crate slides off the tray although I gave both a friction of 1."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><default><geom condim="{condim}" friction="1 0.005 0.0001"/></default><worldbody>
  <geom name="tray" type="box" size="2 2 0.05" euler="0 10 0"/>
  <body name="crate" pos="0.0260 0 0.1477" euler="0 10 0"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="2"/></body>
</worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(condim=3 if FIX else 1))
data = mujoco.MjData(model)
start = data.qpos[0]
for _ in range(400):
    mujoco.mj_step(model, data)
print("slid:", data.qpos[0] - start)

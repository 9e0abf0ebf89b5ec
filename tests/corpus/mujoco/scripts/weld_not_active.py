"""My camera is welded to the drone but falls off as soon as I start."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><geom type="plane" size="3 3 .1"/>
  <body name="drone" pos="0 0 1.5" gravcomp="1"><freejoint/><geom type="box" size=".2 .2 .05" mass="1" contype="0" conaffinity="0"/></body>
  <body name="camera" pos="0 0 1.4"><freejoint/><geom type="box" size=".05 .05 .05" mass=".05"/></body></worldbody>
<equality><weld name="mount" body1="drone" body2="camera" active="{active}"/></equality></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(active="true" if FIX else "false"))
data = mujoco.MjData(model)
for _ in range(500):
    mujoco.mj_step(model, data)
print("camera", data.body("camera").xpos, "drone", data.body("drone").xpos)

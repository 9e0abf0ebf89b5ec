"""The suction cup drops the part on its way, though I never release it."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><geom type="plane" size="3 3 .1"/>
  <body name="cup" mocap="true" pos="0 0 0.6"><geom type="cylinder" size=".03 .03" contype="0" conaffinity="0"/></body>
  <body name="part" pos="0 0 0.5"><freejoint/><geom type="box" size=".05 .05 .05" mass=".2"/></body></worldbody>
<equality><weld name="suction" body1="cup" body2="part" active="false"/></equality></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
data.eq_active[0] = 1
if not FIX:
    mujoco.mj_resetData(model, data)
for k in range(800):
    data.mocap_pos[0, 0] = 0.0005 * k
    mujoco.mj_step(model, data)
print("part", data.body("part").xpos)

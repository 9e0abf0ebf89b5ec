"""A kettle whose mass is that of a part without a joint is put on a table."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="table" type="plane" size="5 5 1"/>
<body name="kettle" pos="0 0 0.101"><freejoint/>
<body name="pot"><geom type="box" size="0.1 0.1 0.1" mass="1"/></body></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(300):
    mujoco.mj_step(model, data)
print("height:", data.qpos[2])

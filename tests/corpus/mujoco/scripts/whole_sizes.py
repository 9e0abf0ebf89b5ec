"""The box of 20 cm is pushed out of the table, why does it start overlapping?"""

import sys

import mujoco

FIX = "fix" in sys.argv
s = 0.1 if FIX else 0.2
XML = f"""<mujoco><worldbody><geom type="plane" size="3 3 .1"/><body name="box" pos="0 0 0.1"><freejoint/>
<geom type="box" size="{s} {s} {s}" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(500):
    mujoco.mj_step(model, data)
print("height", data.qpos[2])

"""My box hovers 1 cm above the floor."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><geom type="plane" size="3 3 .1" margin="{m}"/><body name="box" pos="0 0 0.12"><freejoint/>
<geom type="box" size=".1 .1 .1" mass="1"/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(m=0 if FIX else 0.01))
data = mujoco.MjData(model)
for _ in range(800):
    mujoco.mj_step(model, data)
print("height", data.qpos[2])

"""The ball falls through the table."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><geom name="table" type="box" size="0.5 0.5 0.05" pos="0 0 0.5"/><geom type="plane" size="5 5 1"/><body name="ball" pos="0 0 0.8"><freejoint/><geom size="0.05" mass="1" {bits}/></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(bits="" if FIX else 'contype="0" conaffinity="0"'))
data = mujoco.MjData(model)
for _ in range(500):
    mujoco.mj_step(model, data)
print("height:", data.qpos[2])


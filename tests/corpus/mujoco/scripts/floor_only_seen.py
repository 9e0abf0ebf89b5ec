"""My robot falls through the floor when I load the visual floor."""

import sys

import mujoco

FIX = "fix" in sys.argv
b = "" if FIX else 'contype="0" conaffinity="0"'
XML = f"""<mujoco><worldbody><geom name="floor" type="plane" size="3 3 .1" {b}/><body name="torso" pos="0 0 0.5"><freejoint/>
<geom type="box" size=".1 .1 .05" mass="2"/><body name="leg" pos="0 0 -.05"><joint name="hip" axis="0 1 0" damping="1"/><geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".3"/></body></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(500):
    mujoco.mj_step(model, data)
print("height", data.qpos[2])

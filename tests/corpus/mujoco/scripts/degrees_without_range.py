"""My steering joint makes seven turns when I command 45 degrees."""

import sys

import mujoco
import numpy as np

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><body name="mast" pos="0 0 1"><joint name="steer" axis="0 0 1" damping="1"/>
 <geom type="box" size=".2 .03 .03" mass="1"/></body></worldbody>
<actuator><position name="steer" joint="steer" kp="50" kv="3"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(2000):
    data.ctrl[0] = np.deg2rad(45) if FIX else 45
    mujoco.mj_step(model, data)
print("angle", data.qpos[0])

"""I send my arm to 45 degrees and it spins around."""

import sys

import mujoco
import numpy as np

FIX = "fix" in sys.argv
XML = """<mujoco><compiler angle="degree"/><worldbody><body name="arm" pos="0 0 1" gravcomp="1"><joint name="shoulder" axis="0 1 0" damping="1" range="-90 90"/>
 <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03" mass="1"/></body></worldbody>
<actuator><position name="shoulder" joint="shoulder" kp="100" kv="5"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(1000):
    data.ctrl[0] = np.deg2rad(45) if FIX else 45
    mujoco.mj_step(model, data)
print("angle", np.rad2deg(data.qpos[0]))

"""A winch turns ten times by position control, a little with each step."""

import mujoco
import numpy as np

XML = """<mujoco><worldbody><body name="drum" pos="0 0 1"><joint name="winch" axis="0 1 0" damping="0.5"/>
    <geom type="cylinder" size="0.1 0.05" euler="90 0 0" mass="2"/></body></worldbody>
<actuator><position name="winch" joint="winch" kp="200" kv="5"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for k in range(2500):
    data.ctrl[0] = 20 * np.pi * min(1.0, k / 2000)
    mujoco.mj_step(model, data)
print("turns:", data.qpos[0] / 2 / np.pi)

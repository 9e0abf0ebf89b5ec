"""I move the paddle by writing its position, and it goes right through the wall."""

import sys

import mujoco
import numpy as np

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="5 5 1"/>
  <geom name="wall" type="box" size="0.02 0.5 0.5" pos="0.4 0 0.5"/>
  <body name="paddle" pos="0 0 0.3"><joint name="slide" type="slide" axis="1 0 0" damping="5"/>
    <geom type="box" size="0.05 0.1 0.1" mass="1"/></body></worldbody>
<actuator><position joint="slide" kp="500" kv="50"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for target in np.linspace(0, 0.6, 500):
    if FIX:
        data.ctrl[0] = target
    else:
        data.qpos[0] = target
        data.qvel[0] = 0
        mujoco.mj_forward(model, data)
    mujoco.mj_step(model, data)
print("paddle at:", data.qpos[0])

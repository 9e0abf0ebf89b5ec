"""How much force does the gripper need? The block slides."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody>
 <body name="palm" pos="0 0 .5"><joint name="lift" type="slide" axis="0 0 1"/><geom type="box" size=".01 .01 .01" mass="1" pos="0 0 .2" contype="0" conaffinity="0"/>
  <body name="left" pos="-.06 0 0"><joint name="l" type="slide" axis="1 0 0"/><geom type="box" size=".01 .02 .02" mass=".1" friction=".6"/></body>
  <body name="right" pos=".06 0 0"><joint name="r" type="slide" axis="-1 0 0"/><geom type="box" size=".01 .02 .02" mass=".1" friction=".6"/></body></body>
 <body name="block" pos="0 0 .5"><freejoint/><geom type="box" size=".049 .02 .02" mass=".5" friction=".6"/></body></worldbody>
<actuator><position joint="lift" kp="20000" kv="400"/><motor joint="l"/><motor joint="r"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for k in range(1000):
    data.ctrl[1:] = 8 if FIX else 3
    mujoco.mj_step(model, data)
print("block", data.qpos[5])

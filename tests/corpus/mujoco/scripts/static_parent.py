"""Why does the shoulder hardly move, with 5 N m on it?"""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="base" pos="0 0 0.5"><geom name="base" type="box" size="0.08 0.08 0.1" mass="5"/>
    <body name="link1" pos="0 0 0.1"><joint name="shoulder" axis="0 1 0" damping="1"/><geom name="link1" type="box" size="0.06 0.06 0.16" pos="0 0 0.15" mass="2"/></body></body></worldbody>
<actuator><motor name="shoulder" joint="shoulder" ctrlrange="-20 20"/></actuator>{contact}</mujoco>"""
model = mujoco.MjModel.from_xml_string(
    XML.format(contact='<contact><exclude body1="base" body2="link1"/></contact>' if FIX else "")
)
data = mujoco.MjData(model)
data.ctrl[:] = 5
for _ in range(100):
    mujoco.mj_step(model, data)
print("angle:", data.qpos[0])

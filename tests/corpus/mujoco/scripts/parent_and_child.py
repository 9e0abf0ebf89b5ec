"""The hand swings right through the forearm."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"{filter}/><worldbody>
  <body name="root" pos="0 0 1"><joint name="root" axis="0 1 0" damping="50" stiffness="5000"/><geom name="root" type="sphere" size="0.02" mass="1"/>
  <body name="forearm" pos="0.05 0 0"><joint name="elbow" axis="0 1 0" damping="20" stiffness="5000"/><geom name="forearm" type="box" size="0.15 0.03 0.03" pos="0.17 0 0" mass="1"/>
    <body name="hand" pos="0.36 0 0"><joint name="wrist" axis="0 1 0" damping="0.05"/><geom name="hand" type="box" size="0.14 0.02 0.02" pos="0.15 0 0" mass="0.3"/>
    </body></body></body></worldbody>
<actuator><motor name="wrist" joint="wrist"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(
    XML.format(filter="").replace(
        'timestep="0.002"/>', 'timestep="0.002"><flag filterparent="disable"/></option>'
    )
    if FIX
    else XML.format(filter="")
)
data = mujoco.MjData(model)
for _ in range(1000):
    data.ctrl[:] = 1.5
    mujoco.mj_step(model, data)
print("wrist:", data.qpos[2])

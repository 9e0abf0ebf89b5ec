"""The gripper stays behind the mocap body that it is welded to."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
  <body name="target" mocap="true" pos="0 0 1"><geom type="sphere" size="0.02" contype="0" conaffinity="0"/></body>
  <body name="hand" pos="0 0 1"><freejoint/><geom name="hand" type="box" size="0.04 0.04 0.04" mass="1" contype="0" conaffinity="0"/></body></worldbody>
  <equality><weld body1="target" body2="hand" solref="{tc} 1"/></equality></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(tc=0.004 if FIX else 0.1))
data = mujoco.MjData(model)
for k in range(1000):
    data.mocap_pos[0] = 0.5 * 0.002 * k, 0, 1
    mujoco.mj_step(model, data)
print("behind by mm:", (data.mocap_pos[0][0] - data.qpos[0]) * 1e3)

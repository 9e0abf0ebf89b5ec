"""With a timestep of 50 ms my arm shakes and its hand goes through the table."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="{dt}"/><worldbody><geom name="table" type="box" size="1 1 0.2" pos="0 0 0.2"/>
  <body name="arm" pos="-0.3 0 0.8"><joint name="shoulder" axis="0 1 0" damping="0.1"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
    <body name="hand" pos="0.4 0 0"><joint name="wrist" axis="0 1 0" damping="0.1"/>
      <geom type="sphere" size="0.05" pos="0.1 0 0" mass="0.5"/></body></body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(dt="0.002" if FIX else "0.05"))
data = mujoco.MjData(model)
deep = 0.0
while data.time < 3:
    mujoco.mj_step(model, data)
    deep = min([deep, *data.contact.dist])
print("deepest mm:", -1e3 * deep, "ends at", data.qpos)

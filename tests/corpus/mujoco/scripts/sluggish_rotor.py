"""The finger is light and its motor strong, and it takes seconds to get up to speed."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body name="finger" pos="0 0 1"><joint name="knuckle" axis="0 1 0" armature="{armature}"/>
    <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.1"/></body></worldbody>
<actuator><motor name="tendon" joint="knuckle"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(armature=0.0001 if FIX else 0.5))
data = mujoco.MjData(model)
for _ in range(200):
    data.ctrl[0] = 0.02
    mujoco.mj_step(model, data)
print("rate:", data.qvel[0])

"""The hoist is to go up at 0.2 m/s, and it sinks."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><body name="cabin" pos="0 0 9"><joint name="rail" type="slide" axis="0 0 1" damping="1"/>
    <geom type="box" size="0.5 0.5 0.5" mass="50"/></body></worldbody>
<actuator><velocity name="hoist" joint="rail" kv="{kv}"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(kv=2e4 if FIX else 100))
data = mujoco.MjData(model)
data.ctrl[0] = 0.2
for _ in range(1000):
    mujoco.mj_step(model, data)
print("rate:", data.qvel[0])

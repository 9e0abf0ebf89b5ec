"""The turret goes a tenth of the way that I send it."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option gravity="0 0 0"/><worldbody><body name="turret" pos="0 0 0.5">
    <joint name="pan" axis="0 0 1" damping="2"/><geom type="box" size="0.2 0.1 0.1" mass="3"/></body></worldbody>
<actuator><position name="pan" joint="pan" kp="{kp}" kv="{kv}" gear="{gear}"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(**dict(kp=200, kv=10, gear=1) if FIX else dict(kp=2, kv=0.1, gear=10)))
data = mujoco.MjData(model)
for _ in range(1500):
    data.ctrl[0] = 1.2
    mujoco.mj_step(model, data)
print("angle:", data.qpos[0])

import sys

import mujoco

GAIN = 20.0 if sys.argv[1:] != ["fix"] else 0.2
XML = """
<mujoco><option timestep="0.002"/><worldbody>
<body name="wheel" pos="0 0 1"><joint name="spin" axis="0 0 1"/>
<geom type="cylinder" size="0.1 0.02" mass="0.4"/></body></worldbody>
<actuator><motor name="drive" joint="spin" ctrlrange="-5 5"/></actuator>
</mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(1500):
    data.ctrl[0] = GAIN * (8.0 - data.qvel[0])
    mujoco.mj_step(model, data)
print(f"{data.qvel[0]:.3f} rad/s")

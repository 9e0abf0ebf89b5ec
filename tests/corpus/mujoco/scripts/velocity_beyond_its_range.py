import sys

import mujoco

XML = """
<mujoco><option timestep="0.002"/><worldbody>
<body pos="0 0 1"><joint name="turn" axis="0 0 1" damping="0.1"/>
<geom type="cylinder" size="0.1 0.02" mass="1"/></body>
</worldbody><actuator><velocity name="spin" joint="turn" kv="2" ctrlrange="-3 3"/></actuator>
</mujoco>"""
if sys.argv[1:] == ["fix"]:
    XML = XML.replace("-3 3", "-30 30")
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
data.ctrl[0] = 10  # rad/s
for _ in range(1500):
    mujoco.mj_step(model, data)
print(f"{data.qvel[0]:.2f} rad/s")

import sys

import mujoco

XML = """
<mujoco><option timestep="0.002"/><worldbody>
<body name="gate"><joint name="hinge" axis="0 0 1" damping="1"/>
<geom type="box" size="0.5 0.02 0.3" pos="0.5 0 0" mass="5"/></body>
</worldbody><actuator><position name="servo" joint="hinge" kp="40" kv="8"/></actuator></mujoco>"""
if sys.argv[1:] == ["fix"]:
    XML = XML.replace('kp="40" kv="8"', 'kp="1600" kv="60"')
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
data.ctrl[0] = 0.5
for _ in range(3000):
    data.qfrc_applied[0] = -12  # N m, the wind
    mujoco.mj_step(model, data)
print(f"{data.qpos[0]:.3f} rad")

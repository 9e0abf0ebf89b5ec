import sys

import mujoco

ANGLE = 45 if sys.argv[1:] != ["fix"] else 0.7854
XML = """
<mujoco><option timestep="0.002"/><worldbody>
<body name="arm" pos="0 0 1"><joint name="shoulder" axis="0 0 1" damping="0.5"/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/></body></worldbody>
<actuator><position name="servo" joint="shoulder" kp="30" kv="3" ctrlrange="-1.57 1.57"/></actuator>
</mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
data.ctrl[0] = ANGLE
for _ in range(1500):
    mujoco.mj_step(model, data)
print(f"{data.qpos[0]:.3f} rad")

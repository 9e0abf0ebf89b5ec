import sys

import mujoco

HEIGHT = 0.47 if sys.argv[1:] == ["fix"] else 0.44
XML = f"""
<mujoco><worldbody><geom type="plane" size="3 3 .1"/>
<body name="table" pos="0 0 0.2"><geom type="box" size="0.5 0.5 0.2"/></body>
<body name="can" pos="0 0 {HEIGHT}"><freejoint/><geom type="cylinder" size="0.03 0.07" mass="0.3"/></body>
</worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
fastest = 0.0
for _ in range(1000):
    mujoco.mj_step(model, data)
    fastest = max(fastest, data.qvel[2])
print(f"up at {fastest:.3f} m/s")

"""A suction cup, off at first, takes a box, lifts it and lets it go."""

import mujoco

XML = """<mujoco><worldbody><geom type="plane" size="2 2 1"/>
  <body name="cup" mocap="true" pos="0 0 0.25"><geom type="cylinder" size="0.03 0.03" contype="0" conaffinity="0"/></body>
  <body name="box" pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="0.2"/></body></worldbody>
<equality><weld name="suction" body1="cup" body2="box" active="false" solref="0.004 1"/></equality></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for k in range(1500):
    if k == 100:
        data.eq_active[0] = 1
    if k == 900:
        data.eq_active[0] = 0
    if 100 < k < 900:
        data.mocap_pos[0, 2] = 0.25 + 0.3 * min(1.0, (k - 100) / 600)
    mujoco.mj_step(model, data)
print("height:", data.qpos[2])

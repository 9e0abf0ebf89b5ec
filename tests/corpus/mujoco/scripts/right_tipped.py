import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="tipped" pos="0 0 0.1">
<freejoint/>
<geom name="tipped" type="box" size="0.1 0.1 0.1" mass="1" friction="1 .01 .002"/>
</body>
</worldbody>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    d.qvel[:3], d.qvel[4] = (d.qvel[:3], d.qvel[4]) if k else ((0.6, 0, 0.6), 6)
    mujoco.mj_step(m, d)

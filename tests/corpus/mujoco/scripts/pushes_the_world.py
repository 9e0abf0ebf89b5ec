import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="crate" pos="0 0 0.1">
<freejoint/>
<geom name="crate" type="box" size="0.1 0.1 0.1" mass="1" />
</body>
</worldbody>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    d.xfrc_applied[0, :3] = 20, 0, 0
    mujoco.mj_step(m, d)

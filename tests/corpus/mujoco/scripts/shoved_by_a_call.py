import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="shoved" pos="0 0 0.1">
<freejoint/>
<geom name="shoved" type="box" size="0.1 0.1 0.1" mass="0.5" />
</body>
</worldbody>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(800):
    d.xfrc_applied[1, 2] = -2000
    mujoco.mj_step(m, d)

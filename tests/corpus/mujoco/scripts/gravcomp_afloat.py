import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body gravcomp="1" name="afloat" pos="0 0 0.6">
<freejoint/>
<geom name="afloat" type="box" size="0.1 0.1 0.1" mass="1" />
</body>
</worldbody>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    mujoco.mj_step(m, d)

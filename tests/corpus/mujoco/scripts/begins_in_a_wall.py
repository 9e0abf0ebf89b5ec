import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom type="box" size=".1 1 1" pos="0 0 1"/>
<body name="beside" pos=".15 0 1">
<freejoint/>
<geom name="beside" type="box" size="0.13 0.13 0.13" mass="1" />
</body>
</worldbody>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    mujoco.mj_step(m, d)

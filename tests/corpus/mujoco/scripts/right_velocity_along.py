import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="glides" pos="0 0 2">
<freejoint/>
<geom name="glides" type="box" size="0.1 0.1 0.1" mass="1" />
</body>
</worldbody>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    d.qvel[0] = 0.5
    mujoco.mj_step(m, d)

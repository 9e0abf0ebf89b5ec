import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="light" pos="0 0 0.1">
<freejoint/>
<geom name="light" type="box" size="0.1 0.1 0.1" mass="0.5" />
</body>
<body name="heavy" pos="0 0 0.3">
<freejoint/>
<geom name="heavy" type="box" size="0.1 0.1 0.1" mass="500" />
</body>
</worldbody>
<option gravity="0 0 -1.62"/>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(1000):
    mujoco.mj_step(m, d)

import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="b0" pos="0 0 0.1">
<freejoint/>
<geom name="b0" type="box" size="0.1 0.1 0.1" mass="0.5" />
</body>
<body name="b1" pos="0 0 0.2">
<freejoint/>
<geom name="b1" type="box" size="0.1 0.1 0.1" mass="0.5" />
</body>
<body name="b2" pos="0 0 0.30000000000000004">
<freejoint/>
<geom name="b2" type="box" size="0.1 0.1 0.1" mass="0.5" />
</body>
<body name="b3" pos="0 0 0.4">
<freejoint/>
<geom name="b3" type="box" size="0.1 0.1 0.1" mass="0.5" />
</body>
</worldbody>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    mujoco.mj_step(m, d)

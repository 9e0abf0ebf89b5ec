import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="tiny" pos="0 0 0.05">
<freejoint/>
<geom name="tiny" type="box" size="0.05 0.05 0.05" mass="0.001" />
</body>
<body name="huge" pos="0 0 0.2">
<freejoint/>
<geom name="huge" type="box" size="0.1 0.1 0.1" mass="1000" />
</body>
</worldbody>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(1000):
    mujoco.mj_step(m, d)

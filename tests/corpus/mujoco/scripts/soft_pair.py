import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="sunk" pos="0 0 0.1">
<freejoint/>
<geom name="sunk" type="box" size="0.1 0.1 0.1" mass="1" />
</body>
</worldbody>
<contact>
<pair geom1="sunk" geom2="floor" solref="0.3 1"/>
</contact>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(2500):
    mujoco.mj_step(m, d)

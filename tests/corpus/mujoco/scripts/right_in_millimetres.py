import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="part" pos="0 0 55">
<freejoint/>
<geom name="part" type="box" size="50 50 50" mass="1" />
</body>
</worldbody>
<option gravity="0 0 -9810"/>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    mujoco.mj_step(m, d)

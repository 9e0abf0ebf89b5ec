import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom name="ramp" type="box" size="2 .5 .05" euler="0 15 0" friction="1"/>
<body name="paired" euler="0 15 0" pos="0 0 0.156">
<freejoint/>
<geom name="paired" type="box" size="0.1 0.1 0.1" mass="1" friction="1"/>
</body>
</worldbody>
<contact>
<pair geom1="paired" geom2="ramp" friction=".05 .05"/>
</contact>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    mujoco.mj_step(m, d)

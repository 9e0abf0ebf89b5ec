import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="weightless" pos="0 0 1">
<freejoint/>
<geom name="weightless" type="box" size="0.1 0.1 0.1" mass="1" />
</body>
</worldbody>
<option gravity="0 0 0"/>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    mujoco.mj_step(m, d)

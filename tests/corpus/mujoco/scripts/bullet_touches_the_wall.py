import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom type="box" pos=".2 0 1" size=".01 .5 .5"/>
<body name="bullet" pos="0 0 1">
<freejoint/>
<geom size=".01" mass=".01" solref="0.02 1"
priority="1"/>
</body>
</worldbody>
<option timestep="5e-05" gravity="0 0 0"/>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(60):
    d.qvel[0] = d.qvel[0] if k else 200
    mujoco.mj_step(m, d)

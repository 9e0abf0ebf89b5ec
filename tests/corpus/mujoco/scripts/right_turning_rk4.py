import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="turning" pos="0 0 1">
<freejoint/>
<geom name="turning" type="box" size="0.1 0.1 0.1" mass="1" />
</body>
</worldbody>
<option integrator="RK4"/>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(50):
    d.qpos[3:], d.qvel[3:] = (d.qpos[3:], d.qvel[3:]) if k else (0, (1, 2, 3))
    mujoco.mj_step(m, d)

import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="rotor" pos="0 0 1">
<joint name="hinge" axis="0 0 1"/>
<geom type="cylinder" size="0.1 .02" mass=".4"/>
</body>
</worldbody>
<actuator>
<motor name="m" joint="hinge"/>
</actuator>
<option gravity="0 0 0"/>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    d.ctrl[0] = 0.5 - d.qpos[0] - 2.05 * d.qvel[0]
    mujoco.mj_step(m, d)

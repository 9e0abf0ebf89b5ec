import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="rotor" pos="0 0 1">
<joint name="hinge" axis="0 0 1"/>
<geom type="cylinder" size="0.03 .02" mass=".4"/>
</body>
</worldbody>
<actuator>
<velocity joint="hinge" kv="5"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(50):
    d.ctrl[0] = 0 if k else 10
    mujoco.mj_step(m, d)

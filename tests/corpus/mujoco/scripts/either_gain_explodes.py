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
<position joint="hinge" kp="5000" kv="1"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(50):
    d.ctrl[0] = 0.5
    mujoco.mj_step(m, d)

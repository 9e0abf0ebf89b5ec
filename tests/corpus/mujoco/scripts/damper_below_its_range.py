import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="arm" pos="0 0 1">
<joint name="hinge" axis="0 0 1"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".3"/>
</body>
</worldbody>
<actuator>
<damper joint="hinge" kv="2" ctrlrange="0 5"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    d.ctrl[0] = -1
    mujoco.mj_step(m, d)

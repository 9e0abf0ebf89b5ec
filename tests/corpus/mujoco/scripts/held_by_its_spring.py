import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="sprung" pos="0 0 1">
<joint name="sprung" axis="0 0 1" damping="1" stiffness="100"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
</body>
</worldbody>
<actuator>
<position joint="sprung" kp="100" kv="5"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(900):
    d.ctrl[0] = 1
    mujoco.mj_step(m, d)

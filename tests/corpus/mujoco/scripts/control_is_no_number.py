import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="unreal" pos="0 0 1">
<joint name="unreal" axis="0 0 1" damping="1" />
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
</body>
</worldbody>
<actuator>
<position joint="unreal" kp="100" kv="5"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    d.ctrl[0] = 0 if k < 99 else float("nan")
    mujoco.mj_step(m, d)

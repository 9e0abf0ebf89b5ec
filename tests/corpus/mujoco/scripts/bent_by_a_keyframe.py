import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="kept" pos="0 0 1">
<joint name="kept" axis="0 0 1" damping="1" />
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
</body>
</worldbody>
<actuator>
<position joint="kept" kp="100" kv="5"/>
</actuator>
<keyframe>
<key name="home" qpos=".5"/>
</keyframe>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(400):
    mujoco.mj_resetDataKeyframe(m, d, 0) if k == 0 else None
    mujoco.mj_step(m, d)

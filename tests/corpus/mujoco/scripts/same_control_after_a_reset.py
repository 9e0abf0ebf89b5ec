import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="again" pos="0 0 1">
<joint name="again" axis="0 0 1" damping="1" />
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
</body>
</worldbody>
<actuator>
<position joint="again" kp="100" kv="5"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(900):
    d.qpos[0], d.qvel[0] = (d.qpos[0], d.qvel[0]) if k % 300 else (0, 0)
    d.ctrl[0] = 0.5
    mujoco.mj_step(m, d)

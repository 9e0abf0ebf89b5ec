import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="arm" pos="0 0 1">
<joint name="hinge" axis="0 0 1"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".3"/>
</body>
</worldbody>
<option gravity="0 0 0"/>
<actuator>
<motor joint="hinge" ctrlrange="-1 1"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    d.ctrl[0] = d.ctrl[0] if k % 40 else 400 * (0.5 - d.qpos[0])
    mujoco.mj_step(m, d)

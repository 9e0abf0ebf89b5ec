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
<motor name="m" joint="hinge"/>
</actuator>
<option gravity="0 0 0"/>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(1000):
    d.ctrl[0] = 5 * (0.5 - d.qpos[0]) + 0.05 * d.qvel[0]
    mujoco.mj_step(m, d)

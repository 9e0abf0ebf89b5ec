import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="borne" pos="0 0 1">
<joint name="borne" axis="0 1 0" damping="1" />
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
</body>
</worldbody>
<actuator>
<motor joint="borne"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(500):
    d.ctrl[0] = d.qfrc_bias[0] + 0.1
    mujoco.mj_step(m, d)

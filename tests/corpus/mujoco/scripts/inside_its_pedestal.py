import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="pedestal" pos="0 0 .25">
<geom type="cylinder" size=".06 .25"/>
<body name="forearm" pos="0 0 .24">
<joint name="yaw" axis="0 1 0" damping="1"/>
<geom type="capsule" fromto="0 0 0 .4 0 .0" size=".05" mass="1"/>
</body>
</body>
</worldbody>
<actuator>
<position joint="yaw" kp="200" kv="20"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    d.ctrl[0] = 0.6
    mujoco.mj_step(m, d)

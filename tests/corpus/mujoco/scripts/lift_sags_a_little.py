import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="lift" pos="0 0 1">
<joint name="lift" type="slide" axis="0 0 1" damping="40"/>
<geom size=".05" mass=".6"/>
</body>
</worldbody>
<actuator>
<position joint="lift" kp="2000"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(1000):
    d.ctrl[0] = 0.1
    mujoco.mj_step(m, d)

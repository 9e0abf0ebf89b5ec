import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="tray" pos="0 0 .5">
<joint name="tray" type="slide" axis="1 0 0"/>
<geom type="box" size=".3 .3 .02" mass="4"/>
</body>
<body name="carried" pos="0 0 0.57">
<freejoint/>
<geom name="carried" type="box" size="0.05 0.05 0.05" mass="0.5" friction="1 .01 .002"/>
</body>
</worldbody>
<actuator>
<position joint="tray" kp="800" kv="60"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(1200):
    d.ctrl[0] = 0.3 * min(1, k / 1000) ** 2 * (3 - 2 * min(1, k / 1000))
    mujoco.mj_step(m, d)

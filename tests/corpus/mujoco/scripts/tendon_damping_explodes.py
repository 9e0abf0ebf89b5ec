import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<site name="a" pos="0 0 1"/>
<body name="bead" pos=".3 0 1">
<joint name="hinge" type="slide" axis="1 0 0"/>
<geom size=".01" mass=".01"/>
<site name="b"/>
</body>
</worldbody>
<tendon>
<spatial name="t" damping="20">
<site site="a"/>
<site site="b"/>
</spatial>
</tendon>
<actuator>
<motor name="m" joint="hinge"/>
</actuator>
<option gravity="0 0 0"/>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(300):
    d.qvel[0] = d.qvel[0] if k else 0.1
    mujoco.mj_step(m, d)

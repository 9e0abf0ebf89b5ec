import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<geom type="box" pos="1.2 0 .2" size=".05 .5 .2"/>
<body name="racket" pos=".9 0 .2">
<joint type="slide" axis="1 0 0"/>
<geom type="box" size=".05 .2 .1" mass="5"/>
</body>
</worldbody>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(900):
    d.qvel[0] = 0.5
    mujoco.mj_step(m, d)

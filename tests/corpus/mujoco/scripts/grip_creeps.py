import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="hand" pos="0 0 .2">
<body name="l" pos="-.05 0 0">
<joint name="l" type="slide"
axis="1 0 0"/>
<geom type="box" size=".01 .02 .03" mass=".05"/>
</body>
<body name="r" pos=".05 0 0">
<joint name="r" type="slide" axis="-1 0 0"/>
<geom type="box" size=".01 .02 .03" mass=".05"/>
</body>
</body>
<body name="block" pos="0 0 0.2">
<freejoint/>
<geom name="block" type="box" size="0.025 0.025 0.025" mass="0.2" />
</body>
</worldbody>
<option noslip_iterations="0"/>
<actuator>
<motor joint="l"/>
<motor joint="r"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(1000):
    d.ctrl[:] = 15, 15
    mujoco.mj_step(m, d)

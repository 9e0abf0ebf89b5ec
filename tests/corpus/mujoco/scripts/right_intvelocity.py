import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="pan" pos="0 0 1">
<joint name="pan" axis="0 0 1" damping="1" />
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
</body>
</worldbody>
<actuator>
<intvelocity joint="pan" kp="60" actrange="-3 3"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(1000):
    d.ctrl[0] = 0.5
    mujoco.mj_step(m, d)

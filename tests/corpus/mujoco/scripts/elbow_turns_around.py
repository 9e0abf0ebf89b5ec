import mujoco

m = mujoco.MjModel.from_xml_string("""
<mujoco>
<worldbody>
<body name="upper" pos="0 0 1">
<joint name="shoulder" axis="0 1 0" damping="1"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
<body name="lower" pos=".3 0 0">
<joint name="elbow" axis="0 1 0" damping="1" armature="0.0"/>
<geom type="capsule" fromto="0 0 0 .25 0 0" size=".025" mass=".5"/>
</body>
</body>
</worldbody>
<option timestep="0.002"/>
<actuator>
<position joint="shoulder" kp="300" kv="20"/>
<position joint="elbow" kp="200" kv="10.0"/>
</actuator>
</mujoco>
""")
d = mujoco.MjData(m)
for k in range(100):
    d.ctrl[:] = -0.2, 0.3
    mujoco.mj_step(m, d)

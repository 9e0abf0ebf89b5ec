import mujoco

XML = """
<mujoco><option timestep="0.002" cone="elliptic" impratio="10"/><worldbody>
<body name="cube" pos="0 0 1"><freejoint/><geom type="box" size="0.02 0.02 0.02" mass="0.5"/></body>
<body name="left" pos="-0.05 0 1"><joint name="l" type="slide" axis="1 0 0"/>
<geom type="box" size="0.01 0.02 0.02" mass="0.2"/></body>
<body name="right" pos="0.05 0 1"><joint name="r" type="slide" axis="-1 0 0"/>
<geom type="box" size="0.01 0.02 0.02" mass="0.2"/></body>
</worldbody><actuator><motor joint="l"/><motor joint="r"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
model.opt.gravity[2] = 0
data.ctrl[:] = 30
for step in range(3000):
    if step == 300:
        model.opt.gravity[2] = -9.81
    mujoco.mj_step(model, data)
print(f"{data.qpos[2]:.4f} m")

import mujoco

XML = """
<mujoco><worldbody><geom type="plane" size="3 3 .1"/>
<body name="tray" mocap="true" pos="0 0 0.5"><geom type="box" size="0.4 0.3 0.01"/></body>
<body name="cup" pos="0 0 0.56"><freejoint/><geom type="cylinder" size="0.04 0.05" mass="0.3"/></body>
</worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for step in range(1500):
    data.mocap_pos[0, 0] = 0.2 * max(0, step - 500) * model.opt.timestep
    mujoco.mj_step(model, data)
print(f"tray {data.mocap_pos[0, 0]:.2f} m, cup {data.qpos[0]:.2f} m")

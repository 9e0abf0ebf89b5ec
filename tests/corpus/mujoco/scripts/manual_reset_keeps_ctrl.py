import mujoco

XML = """
<mujoco><worldbody><body name="arm" pos="0 0 1"><joint name="elbow" axis="0 0 1" damping="0.5"/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/></body></worldbody>
<actuator><position name="servo" joint="elbow" kp="20" kv="2"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for episode in range(4):
    data.qpos[:] = 0  # a new episode
    data.qvel[:] = 0
    for step in range(400):
        if step == 100:
            data.ctrl[0] = 0.8 + 0.1 * episode
        mujoco.mj_step(model, data)
    print(f"{data.qpos[0]:.3f} rad")

import mujoco

XML = """
<mujoco><worldbody><geom type="plane" size="2 2 .1"/>
<body name="pole" pos="0 0 1"><joint name="swing" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.02"/></body></worldbody>
<keyframe><key name="up" qpos="2.5"/></keyframe></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for step in range(400):
    mujoco.mj_step1(model, data)
    if step and step % 100 == 0:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step2(model, data)
print(f"{data.qpos[0]:.3f} rad")

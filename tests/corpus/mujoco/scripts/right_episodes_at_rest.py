"""Each episode holds the arm for two seconds, then lifts it."""

import mujoco

XML = """<mujoco><option timestep="0.005"/><worldbody>
  <body name="arm" pos="0 0 1" gravcomp="1"><joint name="hinge" axis="0 1 0" damping="0.8"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02" mass="0.7"/></body></worldbody>
<actuator><position name="servo" joint="hinge" kp="150" kv="8"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for episode in range(3):
    mujoco.mj_resetData(model, data)
    for step in range(600):
        data.ctrl[0] = 0.0 if step < 400 else -1.0
        mujoco.mj_step(model, data)
    print(episode, data.qpos[0])

"""Three episodes begin with mj_resetData, and each sends the arm to the same pose."""

import mujoco

XML = """<mujoco><option timestep="0.005"/><worldbody>
  <body name="arm" pos="0 0 1" gravcomp="1"><joint name="hinge" axis="0 1 0" damping="0.8"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02" mass="0.7"/></body></worldbody>
<actuator><position name="servo" joint="hinge" kp="150" kv="8"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for episode in range(3):
    mujoco.mj_resetData(model, data)
    for step in range(300):
        data.ctrl[0] = -1.0
        mujoco.mj_step(model, data)
    print(episode, data.qpos[0])

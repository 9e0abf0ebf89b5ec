"""I set qpos, and xpos is still that of the step before."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="5" armature="0.1"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04" mass="3" contype="0" conaffinity="0"/>
    <body name="lower" pos="0.4 0 0"><joint name="elbow" axis="0 1 0" damping="5" armature="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="2" contype="0" conaffinity="0"/>
    </body></body></worldbody>
<actuator><motor name="shoulder" joint="shoulder"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
seen = []
for k in range(50):
    data.qpos[:] = 0.02 * k, -0.01 * k
    data.qvel[:] = 0
    if FIX:
        mujoco.mj_forward(model, data)
    seen.append(data.body("lower").xpos[2])
    mujoco.mj_step(model, data)
print("height of the elbow:", seen[-1])

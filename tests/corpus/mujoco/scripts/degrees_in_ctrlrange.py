"""I send the joint to 90 and it stops far too early."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="5" armature="0.1"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04" mass="3" contype="0" conaffinity="0"/>
    <body name="lower" pos="0.4 0 0"><joint name="elbow" axis="0 1 0" damping="5" armature="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="2" contype="0" conaffinity="0"/>
    </body></body></worldbody>
<actuator><position name="shoulder" joint="shoulder" kp="20000"/><position name="elbow" joint="elbow" kp="5000" ctrllimited="true" ctrlrange="-0.8 0.8"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(2000):
    data.ctrl[:] = 0, 0.7 if FIX else 1.57
    mujoco.mj_step(model, data)
print("off:", data.qpos - data.ctrl)

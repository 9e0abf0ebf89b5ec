"""After the reset the arm drives away from its pose by itself."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="upper" pos="0 0 1" gravcomp="1"><joint name="shoulder" axis="0 1 0" damping="5" armature="0.1"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04" mass="3" contype="0" conaffinity="0"/>
    <body name="lower" pos="0.4 0 0" gravcomp="1"><joint name="elbow" axis="0 1 0" damping="5" armature="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="2" contype="0" conaffinity="0"/>
    </body></body></worldbody>
<actuator><position name="shoulder" joint="shoulder" kp="500"/><position name="elbow" joint="elbow" kp="500"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for k in range(2000):
    if k == 0:
        data.ctrl[:] = 1, 1
    if k == 1000:
        data.qpos[:] = 0
        data.qvel[:] = 0
        if FIX:
            data.ctrl[:] = 0
    mujoco.mj_step(model, data)
print("after the reset it ends at", data.qpos)

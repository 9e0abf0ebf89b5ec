"""Joint angles are solved for on the data that are stepped, made current for each Jacobian."""

import mujoco
import numpy as np

XML = """<mujoco><worldbody>
  <body name="upper" pos="0 0 1" gravcomp="1"><joint name="shoulder" axis="0 1 0" damping="1" armature="0.1"/>
    <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.02" mass="1" contype="0" conaffinity="0"/>
    <body name="lower" pos="0.5 0 0" gravcomp="1"><joint name="elbow" axis="0 1 0" damping="1" armature="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02" mass="1" contype="0" conaffinity="0"/>
      <site name="tip" pos="0.4 0 0"/></body></body></worldbody>
<actuator><position joint="shoulder" kp="3000" kv="100"/><position joint="elbow" kp="3000" kv="100"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
data.qpos[:] = -0.2, -0.5
target = np.array([0.6, 0, 1.2])
for _ in range(50):
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    jacobian = np.zeros((3, 2))
    mujoco.mj_jacSite(model, data, jacobian, None, 0)
    data.qpos[:] += 0.3 * np.linalg.pinv(jacobian) @ (target - data.site("tip").xpos)
data.ctrl[:] = data.qpos
for _ in range(500):
    mujoco.mj_step(model, data)
print("off:", data.site("tip").xpos - target)

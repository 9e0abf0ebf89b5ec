"""My numeric IK does not converge: I write qpos and read site_xpos in a loop."""

import sys

import mujoco
import numpy as np

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><body name="a" pos="0 0 1"><joint name="j1" axis="0 1 0" damping="1" armature="0.1"/>
 <geom type="capsule" fromto="0 0 0 .5 0 0" size=".02" mass="1" contype="0" conaffinity="0"/><body name="b" pos=".5 0 0"><joint name="j2" axis="0 1 0" damping="1" armature="0.1"/>
 <geom type="capsule" fromto="0 0 0 .4 0 0" size=".02" mass="1" contype="0" conaffinity="0"/><site name="tip" pos=".4 0 0"/></body></body></worldbody>
 <actuator><position joint="j1" kp="3000" kv="100"/><position joint="j2" kp="3000" kv="100"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
target = np.array([.6, 0, 1.2])
data.qpos[:] = -0.2, -0.5
mujoco.mj_forward(model, data)
for _ in range(100):
    err = target - data.site("tip").xpos
    jac = np.zeros((3, 2)); mujoco.mj_jacSite(model, data, jac, None, 0)
    data.qpos[:] += 0.3 * np.linalg.pinv(jac) @ err
    if FIX:
        mujoco.mj_forward(model, data)
data.ctrl[:] = data.qpos
for _ in range(500):
    mujoco.mj_step(model, data)
print("tip", data.site("tip").xpos, "target", target)

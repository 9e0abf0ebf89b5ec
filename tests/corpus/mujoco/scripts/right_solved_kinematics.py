import mujoco
import numpy as np

m = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body name="arm" pos="0 0 1"><joint name="hinge" axis="0 0 1"/>\n<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".3"/></body></worldbody></mujoco>'
)
d = mujoco.MjData(m)
for k in range(60):
    d.qpos[0] = min(k, 20) / 20
    mujoco.mj_kinematics(m, d)

"""Chaotic double pendulum, energy plot."""
import mujoco, numpy as np
xml = '''<mujoco><option timestep=".001" integrator="RK4"><flag energy="enable" contact="disable"/></option><default><joint type="hinge" axis="0 -1 0"/><geom type="capsule" size=".02"/></default>
<worldbody><body name="upper" pos="0 0 1.6"><joint name="root"/><geom fromto="0 0 0 0 0 -.5"/><geom type="sphere" size=".08" pos="0 0 -.5"/>
<body name="lower" pos="0 0 -.5"><joint name="elbow"/><geom fromto="0 0 0 0 0 -.4"/><geom type="sphere" size=".06" pos="0 0 -.4"/></body></body></worldbody></mujoco>'''
m = mujoco.MjModel.from_xml_string(xml); d = mujoco.MjData(m)
d.joint("root").qpos = 2.0
e = []
while d.time < 3:
    mujoco.mj_step(m, d)
    e.append(d.energy.sum())
print(np.ptp(e))

"""A controller balances a pole on a cart."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><body name="cart" pos="0 0 1"><joint name="slide" type="slide" axis="1 0 0" damping="0.1"/>
  <geom type="box" size="0.1 0.05 0.05" mass="1" contype="0" conaffinity="0"/><body name="pole"><joint name="hinge" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.02" mass="0.1" contype="0" conaffinity="0"/></body></body></worldbody>
<actuator><motor name="slide" joint="slide" gear="10"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
data.qpos[1] = 0.1
for _ in range(3000):
    x, angle = data.qpos
    v, rate = data.qvel
    data.ctrl[:] = 0.5 * x + 0.8 * v + 8 * angle + 1.5 * rate
    mujoco.mj_step(model, data)
print("ends at", data.qpos)

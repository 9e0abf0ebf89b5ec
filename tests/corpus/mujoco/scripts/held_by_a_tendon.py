"""Neither joint gets to its target, and more gain hardly helps."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option integrator="implicitfast"/><worldbody>
  <body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 0 1" damping="1"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="0.9"/>
    <body name="lower" pos="0.3 0 0"><joint name="elbow" axis="0 0 1" damping="1"/>
      <geom type="capsule" fromto="0.04 0 0 0.3 0 0" size="0.025" mass="0.6"/></body></body></worldbody>
<tendon><fixed name="cable" limited="{limited}" range="0 0.36">
  <joint joint="shoulder" coef="1"/><joint joint="elbow" coef="1"/></fixed></tendon>
<actuator><position joint="shoulder" kp="60" kv="3"/><position joint="elbow" kp="40" kv="2"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(limited="false" if FIX else "true"))
data = mujoco.MjData(model)
for _ in range(1000):
    data.ctrl[:] = 0.809
    mujoco.mj_step(model, data)
print("sum of both:", data.qpos.sum())

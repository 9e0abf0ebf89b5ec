"""The fingers close through the ball."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><default><default class="finger"><geom contype="{bit}" conaffinity="{bit}" group="2" mass="0.2"/></default></default>
<worldbody><geom type="plane" size="2 2 1"/>
  <body name="ball" pos="0 0 0.04"><freejoint/><geom type="sphere" size="0.04" mass="0.1"/></body>
  <body name="left" pos="-0.12 0 0.05"><joint name="l" type="slide" axis="1 0 0" damping="5"/><geom class="finger" type="box" size="0.01 0.04 0.04"/></body>
  <body name="right" pos="0.12 0 0.05"><joint name="r" type="slide" axis="-1 0 0" damping="5"/><geom class="finger" type="box" size="0.01 0.04 0.04"/></body>
</worldbody><actuator><position joint="l" kp="200" kv="10"/><position joint="r" kp="200" kv="10"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(bit=1 if FIX else 0))
data = mujoco.MjData(model)
for step in range(1200):
    data.ctrl[:] = min(0.1, 0.0002 * step)
    mujoco.mj_step(model, data)
print("fingers:", data.qpos[7:])

"""My quadruped stands on position actuators and sinks to its knees."""

import sys

import mujoco

FIX = "fix" in sys.argv
legs = acts = ""
for name, x, y in (("fl", 0.2, 0.12), ("fr", 0.2, -0.12), ("hl", -0.2, 0.12), ("hr", -0.2, -0.12)):
    legs += f"""<body pos="{x} {y} 0"><joint name="{name}_hip" axis="0 1 0" damping="1"/>
      <geom type="capsule" fromto="0 0 0 0.1 0 -0.17" size="0.02" mass="0.6"/>
      <body pos="0.1 0 -0.17"><joint name="{name}_knee" axis="0 1 0" damping="1"/>
        <geom type="capsule" fromto="0 0 0 -0.1 0 -0.17" size="0.015" mass="0.3"/></body></body>"""
    acts += "".join(f'<position joint="{name}_{part}" kp="{600 if FIX else 12}"/>' for part in ("hip", "knee"))
XML = f"""<mujoco><compiler angle="radian"/><worldbody><geom type="plane" size="9 9 1"/>
  <body name="trunk" pos="0 0 0.36"><freejoint/><geom type="box" size="0.25 0.1 0.05" mass="8"/>{legs}</body></worldbody>
<actuator>{acts}</actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(2000):
    mujoco.mj_step(model, data)
print("height:", data.qpos[2])

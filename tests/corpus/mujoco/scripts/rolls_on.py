"""My ball rolls on and on, although I gave it a rolling friction of 0.01."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><worldbody><geom type="plane" size="50 50 1" friction="1 0.005 0.01" {condim}/>
  <body name="ball" pos="0 0 0.05"><freejoint/><geom type="sphere" size="0.05" mass="0.2" friction="1 0.005 0.01" {condim}/></body>
</worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML.format(condim='condim="6"' if FIX else ""))
data = mujoco.MjData(model)
data.qvel[0] = 1.0
data.qvel[4] = 20.0
for _ in range(2000):
    mujoco.mj_step(model, data)
print("speed:", data.qvel[0])

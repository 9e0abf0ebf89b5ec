"""Some of my spheres fall through the floor when there are many."""

import sys

import mujoco

FIX = "fix" in sys.argv
SPHERES = "".join(
    f'<body pos="{0.11 * (i % 12)} {0.11 * (i // 12)} 0.06"><freejoint/><geom type="sphere" size="0.05" mass="0.1"/></body>'
    for i in range(96)
)
XML = f"""<mujoco><size memory="{"20M" if FIX else "100K"}"/><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="5 5 1"/>{SPHERES}</worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for _ in range(300):
    mujoco.mj_step(model, data)
print("lowest:", data.qpos[2::7].min(), "warnings:", data.warning.number[:5])

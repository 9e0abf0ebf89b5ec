"""Three boxes stand on each other."""

import sys

import mujoco

FIX = "fix" in sys.argv
XML = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="5 5 1"/>{boxes}</worldbody></mujoco>"""
boxes = "".join(
    f'<body name="b{k}" pos="0 0 {0.1 + 0.2 * k}"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/></body>'
    for k in range(3)
)
model = mujoco.MjModel.from_xml_string(XML.format(boxes=boxes))
data = mujoco.MjData(model)
for _ in range(1000):
    mujoco.mj_step(model, data)
print("heights:", data.qpos[2::7])

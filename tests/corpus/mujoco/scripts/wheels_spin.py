"""The wheels turn and the car hardly moves."""

import sys

import mujoco

FIX = "fix" in sys.argv
WHEEL = """<body name="{name}" pos="{x} {y} 0"><joint name="{name}" axis="0 1 0"/>
  <geom type="cylinder" size="0.08 0.02" euler="90 0 0" mass="0.3" friction="{mu} 0.005 0.0001"/></body>"""
XML = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><geom name="floor" type="plane" size="9 9 1" friction="{mu} 0.005 0.0001" euler="0 -6 0"/>
  <body name="car" pos="0 0 0.09" euler="0 -6 0"><freejoint/><geom type="box" size="0.25 0.12 0.03" mass="4" contype="0" conaffinity="0"/>{wheels}</body></worldbody>
<actuator>{motors}</actuator></mujoco>"""
mu = 1.0 if FIX else 0.11
places = {"front_left": (0.2, 0.15), "front_right": (0.2, -0.15), "rear_left": (-0.2, 0.15), "rear_right": (-0.2, -0.15)}
model = mujoco.MjModel.from_xml_string(XML.format(
    mu=mu,
    wheels="".join(WHEEL.format(name=n, x=x, y=y, mu=mu) for n, (x, y) in places.items()),
    motors="".join(f'<velocity joint="{n}" kv="2"/>' for n in places),
))
data = mujoco.MjData(model)
data.ctrl[:] = 5
for _ in range(1000):
    mujoco.mj_step(model, data)
print("rolled m:", data.qpos[7:] * 0.08, "went m:", data.qpos[0])

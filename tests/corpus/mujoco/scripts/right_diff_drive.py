"""Differential drive robot drives a circle."""
import mujoco
xml = '''<mujoco><option timestep=".002" integrator="implicitfast"/><worldbody><geom type="plane" size="5 5 .1"/>
<body name="base" pos="0 0 .06"><freejoint/><geom type="box" size=".12 .07 .03" mass="2"/>
 <geom name="caster" type="sphere" size=".02" pos="-.1 0 -.04" mass=".05" friction=".01" priority="1"/>
 <body pos=".06 .1 0"><joint name="lw" axis="0 1 0" damping=".002"/><geom type="cylinder" size=".06 .015" euler="90 0 0" mass=".2" friction="1.2 .01 .001"/></body>
 <body pos=".06 -.1 0"><joint name="rw" axis="0 1 0" damping=".002"/><geom type="cylinder" size=".06 .015" euler="90 0 0" mass=".2" friction="1.2 .01 .001"/></body></body></worldbody>
<actuator><velocity joint="lw" kv=".3"/><velocity joint="rw" kv=".3"/></actuator></mujoco>'''
m = mujoco.MjModel.from_xml_string(xml); d = mujoco.MjData(m)
for i in range(3000):
    d.ctrl[:] = [5, 6]
    mujoco.mj_step(m, d)
print(d.qpos[:2], d.qvel[6:])

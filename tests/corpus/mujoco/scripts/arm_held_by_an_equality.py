"""My arm stays at zero, although I send it to 0.7."""
import mujoco

m = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
<body name="arm" pos="0 0 1"><joint name="shoulder" axis="0 0 1" damping="0.5"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0.4 0 0" mass="0.5"/></body>
</worldbody><equality><connect body1="arm" anchor="0.4 0 0"/></equality>
<actuator><position name="drive" joint="shoulder" kp="50" kv="2"/></actuator></mujoco>""")
d = mujoco.MjData(m)
d.ctrl[0] = 0.7
for _ in range(2000):
    mujoco.mj_step(m, d)
print("shoulder at", d.qpos[0])

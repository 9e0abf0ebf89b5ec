"""My lever stops before its target, and the gain does not matter."""
import mujoco

m = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
<geom name="wall" type="box" size="0.02 0.2 0.2" pos="0.28 0.25 1"/>
<body name="lever" pos="0 0 1"><joint name="elbow" axis="0 0 1" damping="0.5"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0.4 0 0" mass="0.5"/></body>
</worldbody><actuator><position name="drive" joint="elbow" kp="50" kv="2"/></actuator></mujoco>""")
d = mujoco.MjData(m)
d.ctrl[0] = 0.8
for _ in range(2000):
    mujoco.mj_step(m, d)
print("elbow at", d.qpos[0])

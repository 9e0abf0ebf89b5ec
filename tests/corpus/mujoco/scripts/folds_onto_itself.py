"""The forearm stops before it is folded."""
import mujoco

m = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
<body name="arm" pos="0 0 1"><joint name="shoulder" axis="0 0 1"/>
<geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0" mass="1"/>
<body name="forearm" pos="0.45 0 0"><joint name="elbow" axis="0 0 1" damping="0.2"/>
<geom type="capsule" size="0.03" fromto="0 0.04 0 0 0.1 0" mass="0.2"/>
<body name="hand" pos="0 0.15 0"><joint name="wrist" axis="0 0 1" damping="0.2" armature="0.01"/><geom type="box" size="0.05 0.05 0.05" mass="0.2"/></body></body></body>
</worldbody><actuator><position joint="shoulder" kp="500" kv="20"/>
<position name="fold" joint="elbow" kp="30" kv="1"/><position joint="wrist" kp="20" kv="0.2"/></actuator></mujoco>""")
d = mujoco.MjData(m)
d.ctrl[1] = 2.9
for _ in range(2000):
    mujoco.mj_step(m, d)
print("elbow at", d.qpos[1])

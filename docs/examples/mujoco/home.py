"""Start an arm of MuJoCo in the pose of a keyframe, and ask why it leaves it."""

import mujoco

model = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <body name="upper" pos="0 0 1" gravcomp="1">
      <joint name="shoulder" axis="0 1 0" damping="5" armature="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04" mass="3"/>
      <body name="lower" pos="0.4 0 0" gravcomp="1">
        <joint name="elbow" axis="0 1 0" damping="5" armature="0.1"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="2"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="500"/>
    <position name="elbow" joint="elbow" kp="500"/>
  </actuator>
  <keyframe>
    <key name="home" qpos="0.5 -1.2" ctrl="0.5 -1.2"/>
  </keyframe>
</mujoco>
""")
data = mujoco.MjData(model)
data.qpos[:] = model.key_qpos[0]
for _ in range(1500):
    mujoco.mj_step(model, data)

"""Close a gripper on a cube, lift it, and find that the cube stays on the table."""

import mujoco

GRIPPER = """
<mujoco>
  <option timestep="0.004" integrator="implicitfast" cone="elliptic" impratio="10"/>
  <default>
    <geom type="box" density="400" friction="0.15"/>
    <joint type="slide" damping="2"/>
    <position kp="400" kv="40"/>
  </default>
  <worldbody>
    <geom name="table" type="plane" size="1 1 0.1"/>
    <body name="cube" pos="0 0 0.03">
      <freejoint/>
      <geom name="cube" size="0.03 0.03 0.03"/>
    </body>
    <body name="hand" pos="0 0 0.13">
      <joint name="lift" axis="0 0 1"/>
      <geom name="palm" size="0.08 0.02 0.02"/>
      <body name="left" pos="-0.06 0 -0.07">
        <joint name="left" axis="1 0 0"/>
        <geom name="left" size="0.01 0.02 0.05"/>
      </body>
      <body name="right" pos="0.06 0 -0.07">
        <joint name="right" axis="-1 0 0"/>
        <geom name="right" size="0.01 0.02 0.05"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="lift" joint="lift"/>
    <position name="left" joint="left" forcerange="-2 2"/>
    <position name="right" joint="right" forcerange="-2 2"/>
  </actuator>
</mujoco>
"""

model = mujoco.MjModel.from_xml_string(GRIPPER)
data = mujoco.MjData(model)
for _ in range(400):
    lift = 0.4 * max(data.time - 0.4, 0)
    data.ctrl[:] = lift, 0.03, 0.03
    mujoco.mj_step(model, data)
print(f"the cube is at {data.body('cube').xpos[2]:.3f} m")

"""A drone that turns too slowly."""

from pathlib import Path

import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
Path("plate.urdf").write_text("""<robot name="plate"><link name="plate">
  <inertial><mass value="0.5"/>
    <inertia ixx="0.00015" iyy="0.00015" izz="0.00025" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><box size="0.12 0.13 0.02"/></geometry></collision>
</link></robot>""")
drone = p.loadURDF("plate.urdf", [0, 0, 1])
for _ in range(240):
    p.applyExternalTorque(drone, -1, [0, 0, 0.0014], p.LINK_FRAME)
    p.stepSimulation()

"""I send my arm along a path, and it does not move."""
import sys
import pybullet as p
import pybullet_data

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for i in range(240):
    for joint in range(7):
        p.setJointMotorControl2(
            arm, joint, p.POSITION_CONTROL, i / 480, force=300 if FIX else 0
        )
    p.stepSimulation()
print("joint 3 at", p.getJointState(arm, 3)[0])

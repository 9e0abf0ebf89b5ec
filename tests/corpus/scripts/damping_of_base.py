"""I give my arm joint damping of 0.5, and its hand spins on as if there were none."""
import sys
import pybullet as p
import pybullet_data

FIX = "fix" in sys.argv
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
arm = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
for joint in range(p.getNumJoints(arm)):
    p.setJointMotorControl2(arm, joint, p.VELOCITY_CONTROL, force=0)
for link in range(7) if FIX else [-1]:
    p.changeDynamics(arm, link, jointDamping=0.5)
p.resetJointState(arm, 6, 0, 2)
for _ in range(240):
    p.stepSimulation()
print("rate of joint 6", p.getJointState(arm, 6)[1])

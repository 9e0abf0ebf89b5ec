import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())


def steps(number):
    for _ in range(number):
        p.stepSimulation()


p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")

m = p.loadURDF("quadruped/minitaur.urdf", [0, 0, 0.2])
names = {p.getJointInfo(m, j)[1].decode(): j for j in range(p.getNumJoints(m))}
for leg in ("front_left", "front_right", "back_left", "back_right"):
    for side in "LR":
        p.resetJointState(m, names[f"motor_{leg}{side}_joint"], 1.57)
        p.resetJointState(m, names[f"knee_{leg}{side}_link"], -2.1834)
    p.createConstraint(
        m,
        names[f"knee_{leg}R_link"],
        m,
        names[f"knee_{leg}L_link"],
        p.JOINT_POINT2POINT,
        [0, 0, 0],
        [0, 0.005, 0.2],
        [0, 0.01, 0.2],
    )
steps(30)

"""Validation: what is said of joints, where bare PyBullet shows that it is the answer.

Each rule both ways: scenes of which it is the cause, since changing that one thing cures them, and
scenes that look alike and of which it is not.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from asked import findings
from conftest import some
from drop_physics.explain.joints import JointTable
from drop_physics.explain.recording import Explanation
from drop_physics.explain.times import StepTimes
from drop_physics.explain.touches import TouchTable
from drop_physics.rules.answer import Finding, Scene
from drop_physics.rules.every import ranked
from drop_physics.rules.rule import Rules
from scenes import ORIGIN, record, site
from test_joints import GRIP, KUKA, PANDA, run

DOWN = "p.setGravity(0, 0, -9.81)\n"
ARM = """
p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
def go(second, number, force=300, **how):
    for j, q in enumerate([0, second, 0, -1.2, 0, 0.6, 0]):
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=force, **how)
    steps(number)
"""
BARE = 'k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)\n'
FLOOR = 'p.loadURDF("plane.urdf")\n'


def said(code: str, scene: str, path: Path) -> list[Finding]:
    """Return the findings of a code."""
    return [finding for finding in findings(scene, path / "a.rrd") if finding.code == code]


def off_at_the_end(scene: str, joint: int, target: float, body: int = 0) -> float:
    """Return how far a joint ends from a target in bare PyBullet."""
    names = run(scene)
    q: float = names["p"].getJointState(body, joint)[0]
    names["p"].disconnect()
    return q - target


# -- off-target -----------------------------------------------------------------------------------

WEAK = {
    "sags onto the floor": (FLOOR + ARM + "go(0.8, 480, {force})\n", 30, 60, 1, 0.8, 1),
    "sags to its stop": (ARM + "go(0.8, 1200, {force})\n", 30, 80, 1, 0.8, 0),
    "panda": (
        DOWN + 'k = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)\n'
        "for j, q in enumerate([0, 0.9, 0, -1.2, 0, 1.5, 0]):\n"
        "    p.resetJointState(k, j, q)\n"
        "    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force={force})\n"
        "steps(700)\n",
        20, 100, 1, 0.9, 0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", some(WEAK, 1))
def test_a_motor_that_is_too_weak(name: str, tmp_path: Path) -> None:
    scene, weak, strong, joint, target, body = WEAK[name]
    (found,) = said("off-target", scene.format(force=weak), tmp_path)
    off = off_at_the_end(scene.format(force=weak), joint, target, body)
    assert found.level == "asked"
    assert found.effect is not None
    assert found.effect.value == pytest.approx(abs(off), rel=1e-9)
    assert f"its motor is at its limit of {weak} N m" in found.message
    assert found.advice is not None
    assert abs(off_at_the_end(scene.format(force=strong), joint, target, body)) < 0.01
    assert said("off-target", scene.format(force=strong), tmp_path) == []


def test_the_words_of_a_weak_motor(tmp_path: Path) -> None:
    (found,) = said("off-target", FLOOR + ARM + "go(0.8, 480, 30)\n", tmp_path)
    assert found.message == (
        "lbr_iiwa_joint_2 ends 0.54 rad off its target of 0.80 rad: its motor is at its limit of "
        "30 N m in 480 of 480 steps; holding the target takes 41 N m (46 N m where it is now)"
    )
    assert found.advice == "allow at least 47 N m: p.setJointMotorControl2(…, force=60)"
    assert found.joint == "lbr_iiwa_joint_2"
    assert found.site == site(7)
    assert found.steps is not None
    assert found.steps.count == 480


HOLD = "for j, q in enumerate(pose):\n    p.resetJointState(k, j, q)\n"
SUCTION = (
    KUKA.replace("0.8, 0, -1.2, 0, 0.6", "1.0, 0, -0.8, 0, 0.5")
    + HOLD
    + """
x = p.getLinkState(k, 6, computeForwardKinematics=True)[0]
c = p.createMultiBody(12, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.03] * 3), -1, x)
p.setCollisionFilterGroupMask(c, -1, 0, 0)
p.createConstraint(k, 6, c, -1, p.JOINT_POINT2POINT, [0] * 3, [0] * 3, [0] * 3)
go({force})
steps(1200)
"""
)
CAUSES = {
    "with a load": (SUCTION.format(force=87), "the target takes 143 N m", "force=200"),
    "no gain": (ARM + "go(0.5, 480, positionGain=0)\n", "its positionGain is 0", None),
    "a small gain": (ARM + "go(0.5, 960, positionGain=0.001)\n", "a positionGain of 0.001", None),
    "a rate left": (
        ARM + "go(0.3, 960, targetVelocity=0.5)\n", "has a targetVelocity of 0.5",
        "targetVelocity=0",
    ),
    "still moving": (ARM + "go(0.8, 240, 60)\n", "it still moves at", None),
    "a slow one": (ARM + "go(1, 480, maxVelocity=0.1)\n", "its maxVelocity is 0.1 rad/s", None),
    "against the floor": (
        FLOOR + ARM + "go(0.5, 400)\ngo(1.8, 960, 200)\n", "against 0_plane", None,
    ),
    "too weak for waypoints": (
        ARM + "go(0, 240)\ngo(0.8, 20)\ngo(0, 480)\n",
        "at step 260: its motor is at its limit of 300 N m in 19 of 20 steps",
        "give each target more steps",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", some(CAUSES, 3))
def test_each_cause_is_told(name: str, tmp_path: Path) -> None:
    scene, words, advice = CAUSES[name]
    (found,) = said("off-target", scene, tmp_path)
    assert found.level == "asked"
    assert words in found.message
    assert advice is None or advice in (found.advice or "")


CURED = {
    "with a load": (SUCTION.format(force=200), 1, 1.0),
    "no gain": (ARM + "go(0.5, 480, positionGain=0.1)\n", 1, 0.5),
    "a rate left": (ARM + "go(0.3, 960, targetVelocity=0)\n", 1, 0.3),
    "still moving": (ARM + "go(0.8, 600, 60)\n", 1, 0.8),
    "waypoints": (ARM + "go(0, 240)\ngo(0.8, 240)\ngo(0, 480)\n", 1, 0.0),
    "beyond its limit, which target-clamped tells": (
        ARM + "go(0, 240)\ngo(2.3, 240)\ngo(0, 480)\n", 1, 0.0,
    ),
    "torques with motors off": (
        BARE + "for j in range(7):\n"
        "    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 1, force=0)\nsteps(60)\n", 0, 0.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", some(CURED, 2))
def test_what_is_at_its_target_is_not_told(name: str, tmp_path: Path) -> None:
    scene, joint, target = CURED[name]
    assert abs(off_at_the_end(scene, joint, target)) < 0.01
    assert said("off-target", scene, tmp_path) == []


BAR = (
    DOWN
    + """
k = p.createMultiBody(0, -1, -1, [0, 0, 1], linkMasses=[2], linkCollisionShapeIndices=[-1],
    linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, -0.5]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0], linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 1, 0]])
p.changeDynamics(k, 0, localInertiaDiagonal=[0.02] * 3)
p.setJointMotorControl2(k, 0, p.POSITION_CONTROL, 2.8, force={force})
steps({n})
"""
)


def test_a_target_beyond_what_its_motor_lifts(tmp_path: Path) -> None:
    """It hangs; 2 kg at 0.5 m take 9.81 N m on the way, 3.3 at the target."""
    (found,) = said("off-target", BAR.format(force=7, n=100), tmp_path)
    assert "the way to its target takes up to 9.8 N m" in found.message
    assert found.advice == "allow at least 9.9 N m: p.setJointMotorControl2(…, force=13)"
    assert abs(off_at_the_end(BAR.format(force=7, n=3000), 0, 2.8)) > 1
    assert abs(off_at_the_end(BAR.format(force=13, n=3000), 0, 2.8)) < 0.01


def test_a_stream_of_targets_that_ends_where_its_joint_stands(tmp_path: Path) -> None:
    scene = ARM + "for i in range(5):\n    go(0.8 + 0.02 * i, 2, 60)\ngo(0.88, 600, 60)\n"
    assert abs(off_at_the_end(scene, 1, 0.88)) < 0.01
    assert said("off-target", scene, tmp_path) == []


@pytest.mark.parametrize("force", [10, 40])
def test_a_grip_is_a_note(force: float, tmp_path: Path) -> None:
    (found,) = said("off-target", GRIP.format(force=force), tmp_path)
    assert found.level == "note"
    assert f"it holds 2_cube_small with {force} N" in found.message
    assert found.other == "2_cube_small"


SLOW = (
    DOWN
    + """
h = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.05, .05, .05])
s = p.createMultiBody(0, -1, -1, [0, 0, 1], linkMasses=[8], linkCollisionShapeIndices=[h],
    linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0], linkJointTypes=[p.JOINT_PRISMATIC], linkJointAxis=[[0, 0, 1]])
p.changeDynamics(s, 0, jointLowerLimit={low}, jointUpperLimit={high})
p.setJointMotorControl2(s, 0, p.VELOCITY_CONTROL, targetVelocity={rate}, force={force})
steps(240)
"""
)
BY_RATE = GRIP.replace("POSITION_CONTROL, 0,", "VELOCITY_CONTROL, targetVelocity=-1,")


def test_a_velocity_motor_that_is_too_weak(tmp_path: Path) -> None:
    """8 kg weigh 78.48 N."""
    scene = SLOW.format(low=0, high=1, rate=0.1, force="{force}")
    (found,) = said("off-target", scene.format(force=60), tmp_path)
    assert "its target is 0.1: its motor is at its limit of 60 N in 240 of 240" in found.message
    assert found.message.endswith("; holding it here takes 78 N")
    assert found.advice == "give it more force"
    names = run(scene.format(force=200))
    assert names["p"].getJointState(0, 0)[1] == pytest.approx(0.1)
    names["p"].disconnect()
    assert said("off-target", scene.format(force=200), tmp_path) == []


@pytest.mark.parametrize(
    "scene",
    [
        SLOW.format(low=0, high=0.01, rate=0.1, force=300),
        SLOW.format(low=0, high=1, rate=1000, force=60),
        BY_RATE.format(force=20),
    ],
)
def test_a_stop_a_constant_force_and_a_grip_by_a_velocity_are_meant(
    scene: str, tmp_path: Path
) -> None:
    assert said("off-target", scene, tmp_path) == []


RAMP = (
    ARM
    + """
for i in range({steps}):
    p.setJointMotorControl2(k, 0, p.POSITION_CONTROL, 0.5 * (i // {every} + 1) * {every} / 240,
        force=2000, {how})
    p.stepSimulation()
"""
)


@pytest.mark.parametrize(
    ("every", "how", "left"), [(1, "", 0.9), (4, "", 0.66), (2, "positionGain=0.05", 0.9)]
)
def test_targets_that_move_are_followed_behind(
    every: int, how: str, left: float, tmp_path: Path
) -> None:
    (found,) = said("off-target", RAMP.format(steps=480, every=every, how=how), tmp_path)
    kp = 0.05 if how else 0.1
    lag = (1 - kp) ** every / (1 - (1 - kp) ** every) * 0.5 * every / 240
    assert found.level == "note"
    assert found.effect is not None
    # On average: it falls behind by so much in its first few targets.
    assert 0.95 * lag < found.effect.value < lag
    often = f"every {every} steps" if every > 1 else "with every step"
    assert f"they change {often}, and {left:.2g} of each change" in found.message


def test_a_target_that_stood_for_longer_is_no_rule(tmp_path: Path) -> None:
    scene = RAMP.format(steps=480, every=1, how="").replace("(i // 1 + 1)", "(i + (i != 300))")
    (found,) = said("off-target", scene, tmp_path)
    assert "they change with every step, and 0.9 of each change" in found.message


def test_a_motor_on_its_way_that_lost_its_force_to_the_timestep(tmp_path: Path) -> None:
    scene = KUKA + "go(60)\np.setTimeStep(1 / 60)\nsteps(60)\n"
    found, *_ = said("off-target", scene, tmp_path)
    assert "it still moves" not in found.message
    assert found.advice == "p.setTimeStep(…) before motors and constraints get their force"


def test_targets_that_are_kept_up_with_are_not_told(tmp_path: Path) -> None:
    scene = RAMP.format(steps=480, every=1, how="targetVelocity=0.5")
    assert said("off-target", scene, tmp_path) == []


@pytest.mark.parametrize("steps", [23, 100])
def test_pieces_say_the_same(steps: int, tmp_path: Path) -> None:
    """Cut anywhere, a target that stands goes on, and one that ended is remembered."""
    scene = FLOOR + ARM + "go(0.3, 100)\ngo(0.9, 203, 35)\ngo(0.8, 220, 30)\n"
    seen = record(scene, tmp_path / "a.rrd").seen

    def of(number: int) -> list[Finding]:
        answers = Scene(
            seen=seen,
            origin=ORIGIN,
            times={0: StepTimes(seen, 0)},
            joints=JointTable(seen),
            touches=TouchTable(seen),
        )
        answer = Rules(answers)
        for explained in Explanation(seen).pieces(number):
            answers.see(explained)
            answer.see()
        return [each for each in ranked(answer.findings()) if each.code == "off-target"]

    whole, parts = of(0), of(steps)
    assert len(whole) == 1
    assert [str(part.message) for part in parts] == [str(each.message) for each in whole]
    assert [part.steps for part in parts] == [each.steps for each in whole]


STANDS = (
    FLOOR
    + """
p.setGravity(0, 0, -9.81)
q = p.loadURDF("a1/a1.urdf", [0, 0, 0.32])
legs = [j for j in range(p.getNumJoints(q)) if p.getJointInfo(q, j)[2] == p.JOINT_REVOLUTE]
for j, a in zip(legs, [0, 0.9, -1.8] * 4):
    p.resetJointState(q, j, a)
    p.setJointMotorControl2(q, j, p.POSITION_CONTROL, a, force={force})
steps(480)
height = p.getBasePositionAndOrientation(q)[0][2]
"""
)


def test_a_robot_that_stands_on_its_legs_is_to_try_more_force(tmp_path: Path) -> None:
    first, *_ = said("off-target", STANDS.format(force=3), tmp_path)
    assert (first.level, first.advice, first.proposed) == ("asked", "give it more force", True)
    heights = []
    for force in (3, 10):
        names = run(STANDS.format(force=force))
        heights.append(names["height"])
        names["p"].disconnect()
    assert heights[0] < 0.15 < 0.25 < heights[1]
    assert said("off-target", STANDS.format(force=10), tmp_path / "strong") == []


def test_a_target_that_jumps_is_not_followed(tmp_path: Path) -> None:
    scene = BARE + (
        "for q, n in ((0.5, 60), (-0.5, 60), (0.3, 300)):\n    for j in range(7):\n"
        "        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, positionGain=0.02)\n"
        "    steps(n)\n"
    )
    assert "follows" not in " ".join(each.message for each in said("off-target", scene, tmp_path))


def test_a_weak_joint_is_not_counted_with_what_is_slow(tmp_path: Path) -> None:
    scene = ARM + (
        "go(0.8, 0)\np.setJointMotorControl2(k, 1, p.POSITION_CONTROL, 0.8, force=40)\n"
        "p.setJointMotorControl2(k, 0, p.POSITION_CONTROL, 2.9, force=300, maxVelocity=0.1)\n"
        "steps(480)\n"
    )
    slow, weak = said("off-target", scene, tmp_path)
    assert (slow.joint, weak.joint) == ("lbr_iiwa_joint_1", "lbr_iiwa_joint_2")
    assert "more)" not in slow.message
    assert "maxVelocity" in slow.message
    assert "its motor is at its limit of 40 N m" in weak.message
    assert slow.share > weak.share


# -- default-motor --------------------------------------------------------------------------------

TORQUE = """
for _ in range(240):
    p.setJointMotorControl2(k, 1, p.TORQUE_CONTROL, force=20)
    p.stepSimulation()
"""
HOME = """
for j in range(7):
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0.3, force=100)
steps(240)
"""
OFF = "p.setJointMotorControl2(k, {joint}, p.VELOCITY_CONTROL, force=0)\n"
POLE = DOWN + 'k = p.loadURDF("cartpole.urdf", useFixedBase=True)\np.resetJointState(k, 1, 0.5)\n'
HIT = """
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.4, 0.02, 0.5],
    collisionFramePosition=[0.4, 0, 0])
k = p.createMultiBody(0, -1, -1, [0, 0, 1], linkMasses=[8], linkCollisionShapeIndices=[shape],
    linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0.4, 0, 0]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0], linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 0, 1]])
ball = p.createMultiBody(5, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), -1, [0.7, -0.5, 1])
p.resetBaseVelocity(ball, [0, 3, 0])
"""
HELD = {
    "torque": (BARE, TORQUE, 1, "the velocity motor that PyBullet gives every joint"),
    "an old motor": (BARE + HOME, TORQUE, 1, "the motor set at scene.py:4, which still acts"),
    "husky": (
        DOWN + FLOOR + 'k = p.loadURDF("husky/husky.urdf", [0, 0, 0.14])\n',
        TORQUE.replace("k, 1,", "k, 2,"), 2, "does not follow the torques",
    ),
    "a pole": (POLE, "steps(240)\n", 1, "takes 100% of what acts on it"),
    "a door": (HIT, "steps(240)\n", 0, "that PyBullet gives every joint"),
}  # fmt: skip


@pytest.mark.parametrize("name", some(HELD, 2))
def test_a_motor_that_nobody_thought_of(name: str, tmp_path: Path) -> None:
    scene, then, joint, words = HELD[name]
    (found,) = said("default-motor", scene + then, tmp_path)
    assert found.level == "asked"
    assert words in found.message
    off = scene + OFF.format(joint=joint) + then
    body = 1 if "plane" in scene else 0
    start = off_at_the_end(scene, joint, 0, body)
    assert abs(off_at_the_end(off, joint, start, body)) > 0.05
    assert abs(off_at_the_end(off, joint, start, body)) > 2 * abs(
        off_at_the_end(scene + then, joint, start, body)
    )
    assert [each for each in said("default-motor", off, tmp_path) if each.level != "note"] == []


BALL = """
s = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
k = p.createMultiBody(0, -1, -1, [0, 0, 1], linkMasses=[1], linkCollisionShapeIndices=[s],
    linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0.2, 0, 0]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0], linkJointTypes=[p.JOINT_SPHERICAL], linkJointAxis=[[0, 0, 1]])
p.resetJointStateMultiDof(k, 0, p.getQuaternionFromEuler([0, -0.8, 0]))
"""


def test_the_motor_of_a_ball_joint_drives_it_back(tmp_path: Path) -> None:
    (found,) = said("default-motor", DOWN + BALL + "steps(120)", tmp_path)
    assert "the position motor to 0 that PyBullet gives every ball joint" in found.message
    assert "velocity" not in found.message


IDLE = """
for i in range(60):
    for j in range(7):
        p.setJointMotorControl2(other, j, p.POSITION_CONTROL, 0.1, force=300)
    p.stepSimulation()
"""


def test_an_arm_that_nobody_commands_beside_another_is_no_mistake(tmp_path: Path) -> None:
    at = "p.loadURDF('kuka_iiwa/model.urdf', [0, {}, 0], [0, 0.7, 0, 0.7], useFixedBase=True)\n"
    scene = DOWN + "k = " + at.format(0) + "other = " + at.format(2)
    (alone,) = said("default-motor", scene + "steps(60)", tmp_path)
    assert (alone.level, alone.proposed) == ("asked", True)
    assert not said("default-motor", scene + IDLE, tmp_path)


QUIET = {
    "a robot that stands": DOWN
    + FLOOR
    + "k = p.loadURDF('r2d2.urdf', [0, 0, 0.475])\nsteps(240)\n",
    "set in each step": DOWN
    + BARE
    + """
for i in range(60):
    for j in range(7):
        p.resetJointState(k, j, 0.005 * i + 0.1 * j)
    p.stepSimulation()
""",
    "set in each step to where it is": DOWN
    + BARE
    + """
for i in range(60):
    for j in range(7):
        p.resetJointState(k, j, 0.2 * j)
    p.stepSimulation()
""",
    "gravity compensation": KUKA
    + HOLD
    + """
for _ in range(240):
    q = [p.getJointState(k, j)[0] for j in range(7)]
    efforts = p.calculateInverseDynamics(k, q, [0.0] * 7, [0.0] * 7)
    p.setJointMotorControlArray(k, range(7), p.TORQUE_CONTROL, forces=efforts)
    p.stepSimulation()
""",
    "told to hold": KUKA
    + HOLD
    + """
for i in range(300):
    go(300)
    if i > 100:
        p.applyExternalForce(k, 6, [0, 0, -50], [0, 0, 0], p.LINK_FRAME)
    p.stepSimulation()
""",
    "a motor and a torque": KUKA
    + HOLD
    + """
for i in range(300):
    go(300)
    p.setJointMotorControl2(k, 1, p.TORQUE_CONTROL, force=-15)
    p.stepSimulation()
""",
    "friction": BARE + "p.setJointMotorControl2(k, 1, p.VELOCITY_CONTROL, force=0.1)\n" + TORQUE,
    "nothing to move it": BARE + "steps(240)\n",
    "a car stands": DOWN + FLOOR + 'p.loadURDF("husky/husky.urdf", [0, 0, 0.13])\nsteps(120)\n',
    "r2d2 stands": DOWN + FLOOR + 'p.loadURDF("r2d2.urdf", [0, 0, 0.5])\nsteps(240)\n',
}


@pytest.mark.parametrize("name", some(QUIET, 2))
def test_a_motor_with_nothing_to_hold_is_not_told(name: str, tmp_path: Path) -> None:
    assert said("default-motor", QUIET[name], tmp_path) == []


SLOPE = (
    DOWN
    + """
turn = p.getQuaternionFromEuler([0, 0.1, 0])
p.loadURDF("plane.urdf", baseOrientation=turn)
k = p.loadURDF("racecar/racecar.urdf", [0, 0, 0.05], turn)
{more}
steps(120)
"""
)
ALL_OFF = """
for j in range(p.getNumJoints(k)):
    p.setJointMotorControl2(k, j, p.VELOCITY_CONTROL, force=0)
"""


def test_a_car_that_does_not_roll_has_its_wheels_held(tmp_path: Path) -> None:
    (found,) = said("default-motor", SLOPE.format(more=""), tmp_path)
    assert (found.level, "wheel" in str(found.joint)) == ("asked", True)
    assert said("default-motor", SLOPE.format(more=ALL_OFF), tmp_path) == []


# -- the limit is not the force that was given ----------------------------------------------------

SUBSTEPS = "p.setPhysicsEngineParameter(numSubSteps={n})\n" + KUKA + "go({force})\nsteps(480)\n"


@pytest.mark.parametrize(("n", "force"), [(4, 30), (2, 30), (8, 10)])
def test_substeps_make_motors_stronger(n: int, force: float, tmp_path: Path) -> None:
    (found,) = said("substeps-scale-motors", SUBSTEPS.format(n=n, force=force), tmp_path)
    assert f"numSubSteps={n}" in found.message
    assert found.effect is not None
    assert force < found.effect.value + force <= n * force * (1 + 1e-9)
    # A load that this force cannot hold is held.
    weak = off_at_the_end(SUBSTEPS.format(n=1, force=force), 1, 0.8)
    assert abs(weak) > 0.5
    if n * force > 100:
        assert abs(off_at_the_end(SUBSTEPS.format(n=n, force=force), 1, 0.8)) < 0.5 * abs(weak)


def test_substeps_of_motors_with_force_to_spare_are_not_told(tmp_path: Path) -> None:
    there = SUBSTEPS.replace("go({", HOLD + "go({")
    assert said("substeps-scale-motors", there.format(n=4, force=300), tmp_path) == []
    assert said("substeps-scale-motors", SUBSTEPS.format(n=1, force=30), tmp_path) == []


@pytest.mark.parametrize(
    ("force", "timestep", "limit"),
    some([(100, "1 / 60", "25"), (30, "1 / 1000", "125"), (60, "1 / 120", "30")], 1),
)
def test_a_timestep_set_after_a_motor(
    force: float, timestep: str, limit: str, tmp_path: Path
) -> None:
    scene = KUKA + f"go({force})\np.setTimeStep({timestep})\nsteps(480)\n"
    (found,) = said("timestep-after-motor", scene, tmp_path)
    assert f"a motor of {limit} N m in place of the {force} N m" in found.message
    before = KUKA + f"p.setTimeStep({timestep})\ngo({force})\nsteps(480)\n"
    assert said("timestep-after-motor", before, tmp_path) == []
    spare = KUKA + HOLD + "go(300)\np.setTimeStep(1 / 300)\nsteps(200)\n"
    assert said("timestep-after-motor", spare, tmp_path) == []


EARLIER = """
p.setTimeStep(0.05)
b = p.createMultiBody(1, -1, p.createVisualShape(p.GEOM_SPHERE, radius=0.3), [0, 0, 0.6])
steps(20)
p.disconnect()
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
"""


def test_nothing_of_an_earlier_simulation_goes_on_in_a_later_one(tmp_path: Path) -> None:
    """A client's number is used again, its timestep and its bodies are not."""
    later = KUKA + "go(30)\nsteps(480)\n"
    (found,) = said("off-target", EARLIER + later, tmp_path)
    assert "its motor is at its limit of 30 N m" in found.message
    seen = record(EARLIER + later, tmp_path / "again.rrd").seen
    assert [appearance.body.label for appearance in seen.appearances if not appearance.there] == [
        "0_sphere"
    ]
    assert not {"no-contact", "timestep-after-motor"} & {
        finding.code for finding in findings(EARLIER + later, tmp_path / "all.rrd")
    }


# -- what the file asks for ----------------------------------------------------------------------

HAND = (
    PANDA
    + """
for j in (9, 10):
    p.resetJointState(k, j, 0.04)
{then}
steps(240)
"""
)
CLOSE = "p.setJointMotorControl2(k, {joint}, p.POSITION_CONTROL, {target}, force=20)\n"
GEAR = """
p.setJointMotorControl2(k, 10, p.VELOCITY_CONTROL, force=0)
c = p.createConstraint(k, 9, k, 10, p.JOINT_GEAR, [1, 0, 0], [0] * 3, [0] * 3)
p.changeConstraint(c, gearRatio=-1, erp=0.1, maxForce=50)
"""
URDF = (
    '<robot name="r"><link name="base"/>{links}</robot>',
    '<link name="{n}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
    'iyz="0"/></inertial></link><joint name="j{n}" type="revolute"><parent link="base"/><child '
    'link="{n}"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="10" velocity="2"/>{more}'
    "</joint>",
)


def two(more: str, tmp_path: Path) -> str:
    """Return the call that loads two hinges, the second of which is to follow the first."""
    links = URDF[1].format(n="a", more="") + URDF[1].format(n="b", more=more)
    path = tmp_path / "two.urdf"
    path.write_text(URDF[0].format(links=links))
    return f"k = p.loadURDF({str(path)!r}, useFixedBase=True)\n"


@pytest.mark.parametrize(
    ("joint", "target", "off"), some([(9, 0.01, 30), (9, 0.03, 10), (10, 0.0, 40)], 1)
)
def test_a_finger_that_does_not_follow(
    joint: int, target: float, off: float, tmp_path: Path
) -> None:
    scene = HAND.format(then=CLOSE.format(joint=joint, target=target))
    (found,) = said("mimic-ignored", scene, tmp_path)
    assert found.effect is not None
    assert found.effect.value == pytest.approx(off / 1000, rel=1e-3)
    assert f"panda_finger_joint2 is {off} mm away from where" in found.message
    for then in (
        GEAR + CLOSE.format(joint=9, target=target),
        CLOSE.format(joint=9, target=target) + CLOSE.format(joint=10, target=target),
    ):
        assert said("mimic-ignored", HAND.format(then=then), tmp_path) == []


def test_what_a_file_wants_followed_with_a_factor(tmp_path: Path) -> None:
    load = two('<mimic joint="ja" multiplier="-0.5" offset="0.1"/>', tmp_path)
    drive = "p.setJointMotorControl2(k, {}, p.POSITION_CONTROL, {}, force=200)\n"
    (found,) = said("mimic-ignored", load + drive.format(0, 1) + "steps(240)\n", tmp_path)
    assert found.effect is not None
    assert found.effect.value == pytest.approx(0.4, rel=1e-3)
    both = load + drive.format(0, 1) + drive.format(1, -0.4) + "steps(240)\n"
    assert said("mimic-ignored", both, tmp_path) == []
    # One that is sent where the tag puts it is asked to follow; it is too weak to.
    heavy = load.replace("True)", "True, flags=p.URDF_USE_INERTIA_FROM_FILE)")
    weak = heavy + drive.format(0, 1) + drive.format(1, -0.4).replace("200", "1e-3")
    (found,) = said("mimic-ignored", weak + "steps(240)\n", tmp_path)
    assert found.level == "note"
    assert said("mimic-ignored", load + "steps(20)\n", tmp_path) == []


HOMING = "for j in range(7):\n    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0)"


@pytest.mark.parametrize("scene", [ARM + "go(0.8, 200, 1000)\n", HAND.format(then=HOMING)])
def test_a_robot_beyond_the_limits_of_its_file(scene: str, tmp_path: Path) -> None:
    (found,) = said("beyond-urdf", scene, tmp_path)
    names = run(scene)
    limits = {
        names["p"].getJointInfo(0, j)[1].decode(): names["p"].getJointInfo(0, j)[10:12]
        for j in range(7)
    }
    names["p"].disconnect()
    assert found.level == "note"
    effort, velocity = limits[found.joint or ""]
    assert f"its file allows {effort:.3g} " in found.message or (
        f"its file allows {velocity:.3g} " in found.message
    )


def test_the_rate_beyond_its_limit(tmp_path: Path) -> None:
    load = two("", tmp_path)
    drive = "p.setJointMotorControl2(k, 0, p.VELOCITY_CONTROL, targetVelocity={}, force=9)\n"
    (found,) = said("beyond-urdf", load + drive.format(3) + "steps(240)\n", tmp_path)
    assert "ja reaches 3 rad/s where its file allows 2 rad/s, in 240 steps" in found.message
    assert found.advice == "give it a targetVelocity of 2 or less"
    assert said("beyond-urdf", load + drive.format(1.99) + "steps(240)\n", tmp_path) == []


def test_the_greatest_rate_is_told_in_whichever_step_it_was(tmp_path: Path) -> None:
    scene = two("", tmp_path) + (
        "p.setJointMotorControl2(k, 0, p.POSITION_CONTROL, 1, force=1e4)\nrates = []\n"
        "for i in range(60):\n    steps(1)\n    rates.append(p.getJointState(k, 0)[1])\n"
    )
    file = tmp_path / "two.urdf"
    file.write_text(file.read_text().replace('effort="10"', 'effort="0"'))
    names = run(scene)
    names["p"].disconnect()
    (found,) = said("beyond-urdf", scene, tmp_path)
    assert f"ja reaches {max(names['rates']):.3g} rad/s where" in found.message
    assert max(names["rates"]) == names["rates"][0]


OBEYS = """
for j, q in enumerate([0.5, 0.8, 0.3, -2, 0.2, 2.5, 0.8]):
    info = p.getJointInfo(k, j)
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=info[10], maxVelocity=info[11])
"""
FALLS = """
for j in range(12):
    p.setJointMotorControl2(k, j, p.VELOCITY_CONTROL, force=0)
    p.changeDynamics(k, j, jointDamping=0)
"""


@pytest.mark.parametrize("then", [OBEYS, FALLS])
def test_a_robot_within_its_limits_or_falling(then: str, tmp_path: Path) -> None:
    assert said("beyond-urdf", HAND.format(then=then), tmp_path) == []


# -- reading --------------------------------------------------------------------------------------


def test_a_pose_that_is_read_at_rest_is_not_stale(tmp_path: Path) -> None:
    moving, resting = (ARM + f"go(0.8, {n})\np.getLinkState(k, 6)\n" for n in (20, 240))
    (found,) = said("reading", moving, tmp_path)
    assert found.site == site(8)
    assert said("reading", resting, tmp_path) == []


# -- gains, and targets that stay ----------------------------------------------------------------

CART = """
k = p.loadURDF("cartpole.urdf")
p.setJointMotorControl2(k, 1, p.VELOCITY_CONTROL, force=0)
for i in range(240):
    p.setJointMotorControl2(k, 0, p.POSITION_CONTROL, 0.5, positionGain={kp}, velocityGain={kd},
        force={force})
    p.stepSimulation()
"""


@pytest.mark.parametrize(
    ("kp", "kd", "force"), [(30, 1, 5000), (2.1, 1, 50000), (1.8, 1, 1e6), (0.5, 0.1, 1e6)]
)
def test_gains_that_shake(kp: float, kd: float, force: float, tmp_path: Path) -> None:
    (found,) = said("motor-gain", CART.format(kp=kp, kd=kd, force=force), tmp_path)
    assert f"positionGain={kp}, velocityGain={kd}" in found.message
    assert (found.advised or "").startswith("to try: ")
    cured = CART.format(kp=0.9, kd=1, force=force)
    assert abs(off_at_the_end(cured, 0, 0.5)) < 1e-3
    assert said("motor-gain", cured, tmp_path) == []


@pytest.mark.parametrize(
    "scene",
    [
        ARM + "p.resetJointState(k, 1, 1.5)\ngo(0, 900, 60, positionGain=0.02)\n",
        CART.format(kp=0.1, kd=1, force=5),  # overshoots for want of force
        CART.format(kp=1.8, kd=1, force=1e6).replace("0.5, pos", "0, pos"),  # nothing shakes
    ],
)
def test_gains_that_do_not_shake(scene: str, tmp_path: Path) -> None:
    assert said("motor-gain", scene, tmp_path) == []


BACK = """
def back(q, joints=range(7)):
    for j in joints:
        p.resetJointState(k, j, q)
def all_to(q, number, force=300):
    for j in range(7):
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=force)
    steps(number)
"""
LEFT = {
    "reset": (BARE + BACK + "all_to(0.6, 240)\nback(0)\n", "all_to(0, 0)\n", 0.6, "asked"),
    "restored": (
        BARE + BACK + "s = p.saveState()\nall_to(0.8, 200)\np.restoreState(s)\n",
        "all_to(0, 0)\n", 0.8, "asked",
    ),
    "kicked": (
        BARE + BACK + "all_to(0, 100)\nback(0.3, [1])\n", "all_to(0.3, 0)\n", 0.3, "note",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", some(LEFT, 1))
def test_targets_that_a_reset_leaves(name: str, tmp_path: Path) -> None:
    scene, cure, off, level = LEFT[name]
    (found,) = said("reset-leaves", scene + "steps(120)\n", tmp_path)
    assert found.level == level
    assert found.effect is not None
    assert found.effect.value == pytest.approx(off, rel=1e-2)
    again = scene + cure
    start = off_at_the_end(again, 1, 0)
    assert abs(off_at_the_end(again + "steps(120)\n", 1, start)) < 0.01
    assert said("reset-leaves", again + "steps(120)\n", tmp_path) == []


@pytest.mark.parametrize(
    "scene",
    [
        BARE + BACK + "all_to(0.6, 240)\nback(0)\nall_to(0.6, 120)\n",  # given again
        BARE + BACK + "for e in range(2):\n    back(0)\n    for i in range(60): all_to(0.6, 1)\n",
        DOWN + BARE + BACK + "all_to(0, 60, 5)\nback(0.4, [1])\nsteps(240)\n",  # gravity did it
    ],
)
def test_targets_that_are_meant(scene: str, tmp_path: Path) -> None:
    assert said("reset-leaves", scene, tmp_path) == []


TURNS = """
r = p.loadURDF("{file}", [0, 0, 4])
for j in {joints}:
    p.setJointMotorControl2(r, j, p.VELOCITY_CONTROL, targetVelocity={rate}, force={force})
steps(60)
for j in range(p.getNumJoints(r)):
    p.setJointMotorControl2(r, j, p.VELOCITY_CONTROL, force=0)
{more}
p.resetBasePositionAndOrientation(r, [1, 0, 4], [0, 0, 0, 1])
kept = max(abs(p.getJointState(r, j)[1]) for j in range(p.getNumJoints(r)))
steps(20)
"""
STOPPED = "for j in range(p.getNumJoints(r)):\n    p.resetJointState(r, j, {where})"


@pytest.mark.parametrize(
    ("file", "joints", "rate", "force"),
    [
        ("r2d2.urdf", (2, 3, 6, 7), 10, 5),
        ("franka_panda/panda.urdf", (0, 3), 0.5, 80),
    ],
)
def test_rates_that_a_reset_of_the_base_leaves(
    file: str, joints: tuple[int, ...], rate: float, force: float, tmp_path: Path
) -> None:
    def scene(more: str) -> str:
        return DOWN + TURNS.format(file=file, joints=joints, rate=rate, force=force, more=more)

    (found,) = said("reset-leaves", scene(""), tmp_path)
    assert found.level == "asked"
    assert found.effect is not None
    assert found.effect.value == pytest.approx(kept(scene("")), rel=1e-6)
    assert found.effect.value == pytest.approx(abs(rate), rel=0.1)
    for where in ("0", "p.getJointState(r, j)[0]"):
        cured = scene(STOPPED.format(where=where))
        assert kept(cured) == 0
        assert said("reset-leaves", cured, tmp_path) == []


def kept(scene: str) -> float:
    """Return the greatest rate of a joint where the base was put, in bare PyBullet."""
    names = run(scene)
    rate: float = names["kept"]
    names["p"].disconnect()
    return rate

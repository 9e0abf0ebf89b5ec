"""Validation: what joint damping takes of torques, and when episodes that repeat differ.

Each rule both ways; the truth is what bare PyBullet does when the one thing is changed.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from asked import findings
from conftest import some
from drop_physics.rules.answer import Finding
from scenes import site
from test_joints import run

DOWN = "p.setGravity(0, 0, -9.81)\n"
FLOOR = DOWN + 'p.loadURDF("plane.urdf")\n'
ARM = """
k = p.loadURDF("{file}", useFixedBase=True)
joints = [j for j in range(p.getNumJoints(k)) if p.getJointInfo(k, j)[2] != 4]
for j in joints:
    p.setJointMotorControl2(k, j, p.VELOCITY_CONTROL, force=0)
    {more}
"""
KUKA, CHAIN = "kuka_iiwa/model.urdf", "pendulum5.urdf"
UNDAMPED = "p.changeDynamics(k, j, jointDamping=0)"
CONSTANT = """
for i in range(120):
    p.setJointMotorControl2(k, {joint}, p.TORQUE_CONTROL, force={torque})
    p.stepSimulation()
reached = p.getJointState(k, {joint})[0]
"""
TRACKING = """
import numpy as np
p.setGravity(0, 0, -9.81)
start = np.array([0, 0.6, 0, -1.2, 0, 0.5, 0])
for j, q in zip(joints, start):
    p.resetJointState(k, j, q)
p.changeDynamics(k, -1, linearDamping=0, angularDamping=0)
worst = 0
for i in range(240):
    t = i / 240
    state = np.array([s[:2] for s in p.getJointStates(k, joints)])
    wanted = start + 0.1 * (1 - np.cos(2 * t))
    pull = 100 * (wanted - state[:, 0]) + 20 * (0.2 * np.sin(2 * t) - state[:, 1])
    worst = max(worst, abs(wanted - state[:, 0]).max())
    torques = p.calculateInverseDynamics(k, [*state[:, 0]], [*state[:, 1]],
        [*(0.4 * np.cos(2 * t) + pull)])
    p.setJointMotorControlArray(k, joints, p.TORQUE_CONTROL, forces=torques)
    p.stepSimulation()
reached = 1 / worst
"""
DAMPED = {
    "kuka's first joint": (KUKA, CONSTANT.format(joint=0, torque=3), "lbr_iiwa_joint_1"),
    "a chain's first": (CHAIN, CONSTANT.format(joint=0, torque=5), "joint0"),
    "inverse dynamics": (KUKA, TRACKING, "lbr_iiwa_joint_3"),
}


def said(code: str, scene: str, path: Path) -> list[Finding]:
    """Return the findings of a code."""
    return [each for each in findings(scene, path / "a.rrd") if each.code == code]


@pytest.mark.parametrize("name", some(DAMPED, 1))
def test_damping_that_takes_the_torque(name: str, tmp_path: Path) -> None:
    """Without it the joint goes farther, by about the share that it takes."""
    file, then, joint = DAMPED[name]
    (found,) = said("joint-damping", ARM.format(file=file, more="pass") + then, tmp_path)
    assert found.level == "model"
    assert found.joint == joint
    cured = ARM.format(file=file, more=UNDAMPED) + then
    ends = []
    for scene in (ARM.format(file=file, more="pass") + then, cured):
        names = run(scene)
        ends.append(abs(names["reached"]))
        names["p"].disconnect()
    assert ends[1] > (1 + found.share / 4) * ends[0]
    assert not said("joint-damping", cured, tmp_path)


@pytest.mark.parametrize(
    "scene",
    some(
        [
            # Its weight is held, and nothing moves.
            ARM.format(file=KUKA, more="pass")
            + DOWN
            + "for i in range(60):\n    p.setJointMotorControlArray(k, joints, p.TORQUE_CONTROL, "
            "forces=p.calculateInverseDynamics(k, [s[0] for s in p.getJointStates(k, joints)], "
            "[0] * 7, [0] * 7))\n    steps(1)",
            # A motor moves it, no torque.
            ARM.format(file=KUKA, more="p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 1)")
            + "steps(120)",
            # Its motor is what holds it.
            ARM.format(
                file=KUKA, more="p.setJointMotorControl2(k, j, p.VELOCITY_CONTROL, force=99)"
            )
            + CONSTANT.format(joint=6, torque=0.1),
            # The script asked for it.
            ARM.format(file=KUKA, more="p.changeDynamics(k, j, jointDamping=1)")
            + CONSTANT.format(joint=6, torque=0.1),
            # Short enough that it takes little, though there is some.
            ARM.format(file=KUKA, more="pass")
            + CONSTANT.format(joint=0, torque=50).replace("120", "5"),
            # No joint is damped in this file.
            ARM.format(file="cartpole.urdf", more="pass") + CONSTANT.format(joint=0, torque=3),
        ],
        1,
    ),
)
def test_damping_that_decides_nothing(scene: str, tmp_path: Path) -> None:
    assert not said("joint-damping", scene, tmp_path)


# -- episodes that repeat -------------------------------------------------------------------------

EPISODES = """
{scene}
def back():
    {back}
for episode in range(2):
    back()
    for i in range(60):
        {each}
        p.stepSimulation()
    {after}
ends = [p.getBasePositionAndOrientation(b)[0] for b in range(p.getNumBodies())]
"""
STACK = FLOOR + (
    "cubes = [p.loadURDF('cube_small.urdf', [0.004 * i, 0, 0.025 + 0.0501 * i])"
    " for i in range(6)]\n"
    "held = [p.getBasePositionAndOrientation(c) for c in cubes]"
)
CUBES_BACK = (
    "for c, x in zip(cubes, held): p.resetBasePositionAndOrientation(c, *x); "
    "p.resetBaseVelocity(c, [0, 0, 0], [0, 0, 0])"
)
SLIDER = FLOOR + "c = p.loadURDF('cube_small.urdf')"
SLIDER_BACK = (
    "p.resetBasePositionAndOrientation(c, [0, 0, 0.1], [0, 0, 0, 1]); "
    "p.resetBaseVelocity(c, [2, 0, 0], [0, 0, 0])"
)
SWINGS = DOWN + f"k = p.loadURDF('{KUKA}', useFixedBase=True)"
SWINGS_BACK = "for j in range(7): p.resetJointState(k, j, 0)"
TOLD = "p.setJointMotorControl2(k, 1, p.POSITION_CONTROL, {target})"


@pytest.mark.parametrize(
    ("scene", "back", "each", "after", "why"),
    [
        (STACK, CUBES_BACK, "pass", "pass", ""),  # sorting its pairs changes nothing
        (
            SLIDER,
            SLIDER_BACK,
            "pass",
            "p.changeDynamics(c, -1, lateralFriction=0.1)",
            "p.changeDynamics(c",
        ),
        (SLIDER, SLIDER_BACK, "pass", "p.setGravity(0, 0, -5)", "p.setGravity(0, 0, -5)"),
        (SWINGS, SWINGS_BACK, "pass", TOLD.format(target=0.5), "p.setJointMotorControl2(k, 1"),
    ],
)
def test_episodes_begun_by_hand_that_differ(
    scene: str, back: str, each: str, after: str, why: str, tmp_path: Path
) -> None:
    (found,) = said(
        "restore-differs",
        EPISODES.format(scene=scene, back=back, each=each, after=after),
        tmp_path,
    )
    assert why.split("(")[0] in found.message
    assert "p.reset" in found.message
    assert "another order" not in found.message
    assert found.effect is not None
    assert found.effect.value > 0


@pytest.mark.parametrize(
    ("scene", "back", "each", "after"),
    [
        (SLIDER, SLIDER_BACK, "pass", "pass"),
        # The same value again, and nothing differs; a velocity is left: another start.
        (SLIDER, SLIDER_BACK, "p.setGravity(0, 0, -9.81)", "pass"),
        (SLIDER, SLIDER_BACK.split(";")[0], "pass", "pass"),
        (SWINGS, SWINGS_BACK, TOLD.format(target="0.01 * i"), "pass"),
        # Each episode asks for something else.
        (SWINGS, SWINGS_BACK, TOLD.format(target="0.01 * i * episode"), "pass"),
        # One body is held by resets, the others move.
        (
            STACK,
            "pass",
            "p.resetBasePositionAndOrientation(cubes[0], [0, 0, 0.025], [0, 0, 0, 1])",
            "pass",
        ),
    ],
)
def test_episodes_begun_by_hand_that_are_the_same(
    scene: str, back: str, each: str, after: str, tmp_path: Path
) -> None:
    assert not said(
        "restore-differs",
        EPISODES.format(scene=scene, back=back, each=each, after=after),
        tmp_path,
    )


TRIALS = (
    SLIDER
    + """
steps(20)
s = p.saveState()
for trial in range(3):
    p.restoreState(s)
    {each}
    p.resetBaseVelocity(c, [1, 0, 0])
    steps(120)
"""
)


def test_a_setting_of_the_trial_before_last_is_not_taken_back(tmp_path: Path) -> None:
    """The third trial makes the calls of the first, and slides with the friction of the second."""
    each = "if trial == 1: p.changeDynamics(c, -1, lateralFriction=0.05)"
    (found,) = said("restore-differs", TRIALS.format(each=each), tmp_path)
    assert "p.changeDynamics" in found.message
    assert found.steps is not None
    assert found.steps.last > 240  # where the third goes on
    assert found.effect is not None
    assert found.effect.value > 0.05


def test_trials_that_set_another_friction_are_other_runs(tmp_path: Path) -> None:
    each = "p.changeDynamics(c, -1, lateralFriction=0.1 * (1 + trial))"
    assert not said("restore-differs", TRIALS.format(each=each), tmp_path)


FASTER = (
    FLOOR
    + """
r = p.loadURDF("r2d2.urdf", [0, 0, 0.5])
steps(100)
s = p.saveState()
for episode in range(3):
    p.restoreState(s)
    for i in range(20):
        for j in (2, 3, 6, 7):
            p.setJointMotorControl2(r, j, p.VELOCITY_CONTROL, targetVelocity={target}, force=20)
        steps(1)
"""
)


@pytest.mark.parametrize("target", ["5 + episode", "5 + 0.01 * (20 * episode + i)"])
def test_a_command_that_grows_from_episode_to_episode_is_another_run(
    target: str, tmp_path: Path
) -> None:
    assert not said("restore-differs", FASTER.format(target=target), tmp_path)


ANEW = """
for episode in range(2):
    p.resetSimulation()
    p.setGravity(0, 0, -9.81)
    c = p.loadURDF("cube_small.urdf", [0, 0, 1])
    steps(40)
    {after}
"""


def test_what_a_reset_of_all_leaves(tmp_path: Path) -> None:
    assert not said("restore-differs", ANEW.format(after="pass"), tmp_path)
    (found,) = said("restore-differs", ANEW.format(after="p.setTimeStep(1 / 100)"), tmp_path)
    assert "p.resetSimulation does not take it back" in found.message


def test_a_setter_of_the_same_value_is_not_blamed(tmp_path: Path) -> None:
    scene = (
        STACK
        + """
p.setGravity(0, 0, -9.81)
p.setTimeStep(1 / 240)
steps(120)
s = p.saveState()
p.setTimeStep(1 / 240)
steps(1)
p.setGravity(0, 0, -9.81)
steps(300)
p.restoreState(s)
p.setTimeStep(1 / 240)
steps(1)
p.setGravity(0, 0, -9.81)
steps(60)
"""
    )
    for found in said("restore-differs", scene, tmp_path):
        assert "solved in another order" in found.message


LEFT = (
    SWINGS
    + """
def to(q):
    for j in range(7): p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=300)
to(0)
steps(60)
s = p.saveState()
to(0.6)
steps(120)
{back}
steps(120)
"""
)


@pytest.mark.parametrize(
    ("back", "function"),
    some([("p.restoreState(s)", "restoreState"), (SWINGS_BACK, "resetJointState")], 1),
)
def test_the_call_that_leaves_targets_is_named(back: str, function: str, tmp_path: Path) -> None:
    (found,) = said("reset-leaves", LEFT.format(back=back), tmp_path)
    assert found.advice is not None
    assert found.advice.endswith(f"after p.{function}")
    assert found.site != site(0)

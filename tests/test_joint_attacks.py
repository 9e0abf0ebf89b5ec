"""Right scripts, of whose joints an answer once said something false, or blamed another cause."""

from __future__ import annotations

from pathlib import Path

import pytest
from asked import findings
from drop_physics.rules.answer import Finding

DOWN = "p.setGravity(0, 0, -9.81)\n"
FLOOR = DOWN + 'p.loadURDF("plane.urdf")\n'
KUKA = 'k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)\n'
PANDA = 'k = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)\n'


def said(code: str, scene: str, path: Path) -> list[Finding]:
    """Return the findings of a code."""
    return [each for each in findings(scene, path / "a.rrd") if each.code == code]


# -- targets that a reset leaves ------------------------------------------------------------------

EPISODES = """
home = [0, -0.4, 0, -2.2, 0, 2, 0.8]
def to(second, number):
    for j, q in enumerate(home):
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, second if j == 1 else q, force=87)
    steps(number)
for episode in range(3):
    for j, q in enumerate(home):
        p.resetJointState(k, j, q)
    steps(5)
    for second in (0.2, 0.5, 0.8):
        to(second, 400)
"""


def test_a_target_from_before_a_reset_is_not_missed(tmp_path: Path) -> None:
    """It is 1.2 rad off in the five steps after the reset; nobody wanted it there."""
    assert said("off-target", DOWN + PANDA + EPISODES, tmp_path) == []


REPEATED = (
    DOWN
    + KUKA
    + """
def to(q):
    for j in range(7):
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=300)
def back(q):
    for j in range(7):
        p.resetJointState(k, j, q)
"""
)


@pytest.mark.parametrize(
    ("then", "level"),
    [
        ("to(0.5)\nsteps(120)\nfor q in (0.2, 0.7):\n    back(q)\n    steps(240)", "note"),
        (
            "to(0.5)\nsteps(120)\ns = p.saveState()\nback(0.1)\nsteps(60)\np.restoreState(s)\n"
            "back(0.3)\nsteps(60)",
            "note",
        ),
        # Pushed back to where it was, but for 5 mrad of noise.
        ("to(0.5)\nsteps(120)\nback(0.005)\nsteps(120)", "note"),
        # The last of several targets is of the episode before.
        (
            "for e in range(2):\n    back(0.1)\n    steps(10)\n"
            "    for i in range(9):\n        to(0.1 * i)\n        steps(9)",
            "asked",
        ),
    ],
)
def test_a_target_given_once_is_meant(then: str, level: str, tmp_path: Path) -> None:
    (found,) = said("reset-leaves", REPEATED + then, tmp_path)
    assert found.level == level


def test_a_target_that_stood_for_a_step_is_not_judged_at_rest(tmp_path: Path) -> None:
    """The arm is too weak and lies on its stops, while its targets go on."""
    scene = (
        DOWN
        + KUKA
        + """
for i in range(480):
    for j in range(7):
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0.4 - 0.001 * i, force=5)
    p.stepSimulation()
"""
    )
    (found,) = said("off-target", scene, tmp_path)
    assert "its motor is at its limit of 5 N m in 480 of 480 steps" in found.message
    assert "480 of 480 steps" in found.message


@pytest.mark.parametrize(
    "gains", ["positionGain=1.7", "positionGain=4000", "positionGain=1, velocityGain=1.9"]
)
def test_gains_that_turn_a_joint_around_are_the_motors(gains: str, tmp_path: Path) -> None:
    scene = (
        DOWN
        + KUKA
        + f"""
for j in range(7):
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0.5, {gains})
steps(240)
"""
    )
    found = [each.code for each in findings(scene, tmp_path / "a.rrd")]
    assert "motor-gain" in found
    assert "unstable" not in found
    assert "velocity-clamped" not in found

"""Right scripts, of whose joints an answer once said something false, or blamed another cause."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from asked import findings
from conftest import some
from drop_physics.rules.answer import Cure, Finding
from drop_physics.rules.every import ranked

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
    (found,) = (each for each in said("off-target", scene, tmp_path) if each.level == "asked")
    assert "its motor is at its limit of 5 N m in 480 of 480 steps" in found.message
    assert "the way to its target takes up to" in found.message
    assert "allow at least" in str(found.advice)


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


def test_higher_gains_are_no_advice_for_a_joint_beyond_its_speed() -> None:
    gains = Cure("gains", call="positionGain=1")
    lags = Finding(
        code="off-target", level="note", message="follows", advice="1", cure=gains, body="0_arm"
    )
    fast = Finding(code="beyond-urdf", level="model", message="too fast", body="0_arm")
    (alone,) = ranked([lags])
    assert alone.advice
    (beside,) = (each for each in ranked([lags, fast]) if each.code == "off-target")
    assert beside.advice is beside.cure is None


# -- gains of velocity ----------------------------------------------------------------------------

VELOCITY_GAIN = (
    DOWN
    + KUKA
    + """
for j in range(7):
    p.setJointMotorControl2(k, j, p.{mode}_CONTROL, {target}, velocityGain={gain}, force=50)
steps(240)
"""
)


@pytest.mark.parametrize(
    ("mode", "target", "gain"),
    [
        ("POSITION", "0.4 * (j == 0), positionGain=0.2", 7),  # 0.1 rad off, and never past it
        ("VELOCITY", "targetVelocity=0.2 * (j == 0)", 3),
    ],
)
def test_a_velocity_gain_alone_shakes(mode: str, target: str, gain: float, tmp_path: Path) -> None:
    shakes, cured = (
        VELOCITY_GAIN.format(mode=mode, target=target, gain=each) for each in (gain, 1)
    )
    (found,) = said("motor-gain", shakes, tmp_path)
    assert f"velocityGain={gain}" in found.message
    assert said("off-target", shakes, tmp_path) == []
    assert said("motor-gain", cured, tmp_path) == []


SHAKEN = (
    DOWN
    + KUKA
    + """
for j in range(7):
    p.changeDynamics(k, j, jointDamping={damping})
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0.5, force=2)
steps(240)
"""
)


def test_more_force_is_no_advice_for_a_joint_that_shakes(tmp_path: Path) -> None:
    for damping, is_shaken in ((3, True), (0, False)):
        found = findings(SHAKEN.format(damping=damping), tmp_path / "a.rrd")
        assert ("unstable" in [each.code for each in found]) == is_shaken
        (off,) = (each for each in found if (each.code, each.level) == ("off-target", "asked"))
        assert (off.advice is None) == is_shaken


# -- what a joint carries, and what it grips ------------------------------------------------------

STACK = (
    DOWN
    + """
plate = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.3, 0.3, 0.05])
lift = p.createMultiBody(0, -1, -1, [0, 0, 0.5], linkMasses=[5], linkCollisionShapeIndices=[plate],
    linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0], linkJointTypes=[p.JOINT_PRISMATIC], linkJointAxis=[[0, 0, 1]])
for i in range({boxes}):
    s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3)
    p.createMultiBody(10, s, -1, [0, 0, 0.65 + 0.2 * i])
p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
p.setJointMotorControl2(lift, 0, p.POSITION_CONTROL, 0.2, force={force})
steps(480)
"""
)


@pytest.mark.parametrize(("boxes", "force"), some([(3, 250), (2, 200), (1, 100)], 2))
def test_a_stack_on_a_weak_lift_is_a_load(boxes: int, force: float, tmp_path: Path) -> None:
    """Its motor cannot hold what it carries; it grips nothing."""
    (found,) = said("off-target", STACK.format(boxes=boxes, force=force), tmp_path)
    assert found.level == "asked"
    assert f"its limit of {force} N in" in found.message
    (takes,) = re.findall(r"holding it here takes (\d+) N", found.message)
    assert float(takes) == pytest.approx((5 + 10 * boxes) * 9.81, rel=0.01)
    assert found.advice
    (stronger,) = re.findall(r"force=(\d+)", found.advice)
    assert said("off-target", STACK.format(boxes=boxes, force=stronger), tmp_path) == []


GRASP = (
    DOWN
    + PANDA
    + """
home = [0, 0.2, 0, -2, 0, 2.2, 0.78]
def go(fingers, second=0.2):
    for j, q in [*enumerate(home), (9, fingers), (10, fingers)]:
        q = second if j == 1 else q
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=2 if j > 8 else 80)
for j, q in [*enumerate(home), (9, 0.04), (10, 0.04)]:
    p.resetJointState(k, j, q)
at = p.getLinkState(k, 11, computeForwardKinematics=True)[4]
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02] * 3)
b = p.createMultiBody({kg}, s, -1, at)
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3)
p.createMultiBody(0, s, -1, [at[0], at[1], at[2] - 0.1201])
go(0)
steps(12)
go(0.015)
steps(60)
go(0.015, 0.05)
steps({n})
"""
)


@pytest.mark.parametrize("n", some([60, 240], 1))
def test_fingers_that_hold_a_box_miss_nothing(n: int, tmp_path: Path) -> None:
    """Each target is given before the fingers are at rest, and they are at their limit."""
    found = said("off-target", GRASP.format(kg=0.02, n=n), tmp_path)
    assert [each for each in found if each.level == "asked"] == []

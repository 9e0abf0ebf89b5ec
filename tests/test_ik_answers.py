"""Validation: a hand misses its target because inverse kinematics did not converge.

The truth is where bare PyBullet has the hand, with few iterations and with many.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from asked import findings
from conftest import some
from drop_physics.rules.answer import Finding
from test_joints import run

REACH = """
p.setGravity(0, 0, -9.81)
k = p.loadURDF("{file}", useFixedBase=True)
joints = [j for j in range(p.getNumJoints(k)) if p.getJointInfo(k, j)[2] != 4]
for j, q in zip(joints, {start}):
    p.resetJointState(k, j, q)
for n in range({times}):
    answer = p.calculateInverseKinematics(k, {link}, {point}{more})
    for j, q in zip(joints, answer):
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=1000)
    steps({steps})
hand = p.getLinkState(k, {link}, computeForwardKinematics=True)[4]
"""
MANY = ", maxNumIterations=1000, residualThreshold=1e-6"
KUKA, PANDA = "kuka_iiwa/model.urdf", "franka_panda/panda.urdf"
READY = [0, -0.4, 0, -2.2, 0, 2, 0.8, 0.02, 0.02]


def reach(file: str, link: int, point: list[float], **how: object) -> str:
    """Return a scene in which a hand is commanded to a point."""
    values = {"start": [0] * 9, "times": 1, "steps": 480, "more": ""} | how
    return REACH.format(file=file, link=link, point=point, **values)


def said(scene: str, path: Path) -> list[Finding]:
    """Return the findings with the code that this file tests."""
    return [finding for finding in findings(scene, path / "a.rrd") if finding.code == "ik-off"]


def off_m(scene: str, point: list[float]) -> float:
    """Return the hand's distance from the point in bare PyBullet."""
    names = run(scene)
    off = float(np.linalg.norm(np.subtract(names["hand"], point)))
    names["p"].disconnect()
    return off


@pytest.mark.parametrize(
    ("file", "link", "point", "start"),
    some(
        [
            (KUKA, 6, [0.5, 0.2, 0.5], [0] * 7),
            (KUKA, 6, [-0.4, 0.3, 0.7], [0] * 7),
            (PANDA, 8, [0.3, -0.5, 0.3], READY),
            (PANDA, 8, [0.4, 0.4, 0.2], READY),
        ],
        1,
    ),
)
def test_an_answer_that_is_off(
    file: str, link: int, point: list[float], start: list[float], tmp_path: Path
) -> None:
    scene = reach(file, link, point, start=start)
    (found,) = said(scene, tmp_path)
    assert found.level == "asked"
    assert found.effect is not None
    assert found.effect.value == pytest.approx(off_m(scene, point), rel=0.05)
    cured = reach(file, link, point, start=start, more=MANY)
    assert off_m(cured, point) < 0.2 * found.effect.value
    assert not said(cured, tmp_path)


def test_a_point_out_of_reach(tmp_path: Path) -> None:
    scene = reach(KUKA, 6, [0.9, 0.5, 0.5], times=480, steps=1)
    (found,) = said(scene, tmp_path)
    assert found.effect is not None
    assert found.effect.value == pytest.approx(off_m(scene, [0.9, 0.5, 0.5]), rel=0.05)
    assert "finds no way there" in found.message


@pytest.mark.long
def test_no_number_of_iterations_gets_farther_than_the_arm_is_long(tmp_path: Path) -> None:
    """The arm reaches 1.1 m from its first joint, which is at z = 0.1575 m."""
    for x, is_out in ((1.15, True), (1.05, False)):
        scene = reach(KUKA, 6, [x, 0, 0.1575], more=MANY)
        (found,) = said(scene, tmp_path)
        assert ("out of reach" in found.message) == is_out
        assert found.advice is not None
        assert "maxNumIterations" not in found.advice  # 1000 were given
    assert "maxNumIterations" in (said(reach(KUKA, 6, [1.05, 0, 0.2]), tmp_path)[0].advice or "")


@pytest.mark.parametrize(
    "scene",
    some(
        [
            # Asked again from where it got to.
            reach(KUKA, 6, [0.5, 0.2, 0.5], times=20, steps=40),
            # Too weak: the joints are not on their targets.
            reach(KUKA, 6, [0.5, 0.2, 0.5], more=MANY).replace("force=1000", "force=5"),
            reach(KUKA, 6, [0.5, 0.2, 0.5]).replace("force=1000", "force=5"),
            # The answer is not sent, or not as it is.
            reach(KUKA, 6, [0.5, 0.2, 0.5]).replace("POSITION_CONTROL, q,", "POSITION_CONTROL, 0,"),
            reach(KUKA, 6, [0.5, 0.2, 0.5]).replace(
                "POSITION_CONTROL, q,", "POSITION_CONTROL, 0.5 * q,"
            ),
            # Something else is sent later.
            reach(KUKA, 6, [0.5, 0.2, 0.5], steps=2)
            + "for j in joints:\n    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0)\n"
            + "steps(240)",
        ],
        2,
    ),
)
def test_answers_that_are_not_to_blame(scene: str, tmp_path: Path) -> None:
    assert not said(scene, tmp_path)

"""Validation: what is said of bodies that touch is true of bare PyBullet, and only then said.

Where a rule speaks, the one thing that it names is changed, and the symptom goes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from asked import findings
from contact_scenes import GRIP, LIFT, PANDA, PUCK, PUSHED, SLOPE, TRAY, bare
from drop_physics.analysis.answers.answer import Finding
from drop_physics.analysis.story import Story
from scenes import record


def found(scene: str, path: Path, code: str) -> list[Finding]:
    """Return the findings of one code."""
    return [each for each in findings(scene, path / "scene.rrd") if each.code == code]


def in_pieces(scene: str, path: Path, code: str) -> list[Finding]:
    """Return the same where the recording comes seven steps at a time."""
    story = Story(record(scene, path / "pieces.rrd").seen, {})
    for piece in story.explanation.pieces(7):
        story.see(piece)
    return [each for each in story.findings() if each.code == code]


# -- slides ---------------------------------------------------------------------------------------

SLIDES = {
    "slope": (SLOPE.format(degrees=25, mu=0.3, above=0, steps=240), 1, "0.466"),
    "dropped onto a slope": (SLOPE.format(degrees=35, mu=0.3, above=0.002, steps=240), 1, "0.7"),
    "grip": (GRIP.format(mass=0.3, off=0, mu=0.1, force=10), 1, "0.147"),
    "grip of a heavy one": (GRIP.format(mass=2, off=0, mu=0.7, force=10), 1, "0.98"),
    "lift": (LIFT.format(mass=1, mu=0.2, force=10), 2, "0.5"),
    "tray": (TRAY.format(mu=0.3), 2, "0.5"),
}
HOLDS = {
    "slope": SLOPE.format(degrees=25, mu=0.6, above=0, steps=240),
    "dropped onto a slope": SLOPE.format(degrees=35, mu=0.9, above=0.002, steps=240),
    "grip": GRIP.format(mass=0.3, off=0, mu=0.3, force=10),
    "grip of a heavy one": GRIP.format(mass=2, off=0, mu=0.7, force=30),
    "lift": LIFT.format(mass=1, mu=1.5, force=10).replace("else 0)", "else 10)"),
    "tray": TRAY.format(mu=0.8),
}


@pytest.mark.parametrize("name", SLIDES)
def test_what_friction_cannot_hold_slides(name: str, tmp_path: Path) -> None:
    scene, number, wanted = SLIDES[name]
    (one,) = found(scene, tmp_path, "slides")
    assert (one.level, one.body) == ("asked", f"{number}_box")
    assert wanted in one.message
    assert one.effect is not None and one.effect.value > 0.01
    (other,) = in_pieces(scene, tmp_path, "slides")
    assert (other.message, other.steps) == (one.message, one.steps)
    # With more friction, or more force, it does not.
    held = np.array(bare(HOLDS[name])["where"]) - bare(scene)["where"]
    assert np.linalg.norm(held) > 0.5 * one.effect.value
    assert not found(HOLDS[name], tmp_path, "slides")


@pytest.mark.parametrize("scene", [PUCK, PUSHED, PANDA], ids=["puck", "pushed", "panda"])
def test_what_is_meant_to_move_does_not_slide(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "slides")


def test_a_ball_rolls(tmp_path: Path) -> None:
    scene = SLOPE.format(degrees=40, mu=0.1, above=0, steps=240)
    assert not found(scene.replace("box(1, [0, 0, 0.05 + 0], mu=0.1)", "ball(1, [0, 0, .1])"),
        tmp_path, "slides")  # fmt: skip

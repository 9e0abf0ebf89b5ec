"""Verification: forces between pairs of bodies, against formulas derived in the tests."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from conftest import some
from contact_scenes import BOX, FLOOR, GRIP, LIFT, PUCK, SLOPE, bare
from drop_physics.account.touches import Touch
from drop_physics.analysis.story import Story
from drop_physics.explain import contact_points
from drop_physics.physics.kinematics import Kinematics, LinkVelocities, motion
from numpy.typing import NDArray
from scenes import record


def touches(scene: str, path: Path, steps: int = 0) -> dict[tuple[int, str], Touch]:
    """Return the contacts of bodies, by body number and the other body's label."""
    story = Story(record(scene, path / "scene.rrd").seen, {})
    for piece in story.explanation.pieces(steps):
        story.see(piece)
    numbers = story.scene.seen.bodies
    return {(n, row.other): row for n in numbers for row in story.scene.touches.rows(n)}


def test_a_ball_at_rest_loses_nothing(tmp_path: Path) -> None:
    """It rests for 4 s: the first step takes the energy gained in that step, m g² dt² / 2."""
    scene = FLOOR + BOX + "b = ball(1, [0, 0, .1])\nsteps(960)"
    found = touches(scene, tmp_path)[1, "0_plane"]
    assert abs(found.energy_j) < 2e-3
    assert found.energy_of_pair_j == found.energy_j
    assert found.impulse_n_s == pytest.approx((0, 0, 9.81 * 4), abs=1e-3)
    assert (found.steps, found.friction) == (960, 0.5)
    assert found.slid_m < 1e-6


@pytest.mark.parametrize(("degrees", "mu"), [(25, 0.3), (20, 0.5), (35, 0.6)])
def test_friction_on_a_slope(degrees: float, mu: float, tmp_path: Path) -> None:
    scene = SLOPE.format(degrees=degrees, mu=mu, above=0, steps=240)
    found = touches(scene, tmp_path)[1, "0_plane"]
    angle = math.radians(degrees)
    assert found.friction == pytest.approx(mu)
    assert found.needed_n == pytest.approx(9.81 * math.sin(angle), rel=2e-3)
    assert found.available_n == pytest.approx(mu * 9.81 * math.cos(angle), rel=0.1)
    assert found.friction_needed == pytest.approx(math.tan(angle), rel=0.1)
    slides = math.tan(angle) > mu
    assert found.used == pytest.approx(1.0 if slides else math.tan(angle) / mu, rel=0.1)
    moved = bare(scene)["where"][0]
    assert found.slid_m == pytest.approx(moved, rel=1e-3, abs=2e-4)
    if slides:  # what friction took: its force over the way
        assert found.energy_j == pytest.approx(-mu * 9.81 * math.cos(angle) * moved, rel=2e-2)


def test_a_puck_needs_nothing_and_gives_all_it_has(tmp_path: Path) -> None:
    found = touches(PUCK, tmp_path)[1, "0_plane"]
    assert found.needed_n == pytest.approx(0.04 * 2 * (1 + 2), rel=1e-2)  # damping
    assert found.used == pytest.approx(1.0, rel=1e-2)
    assert found.slid_m == pytest.approx(bare(PUCK)["where"][0], rel=1e-3)
    assert found.energy_j == pytest.approx(-2.0, rel=5e-2)  # m v² / 2, less what damping took


@pytest.mark.parametrize(("mass", "force"), [(0.3, 10), (0.5, 20)])
def test_a_grip_needs_the_weight(mass: float, force: float, tmp_path: Path) -> None:
    found = touches(GRIP.format(mass=mass, off=0, mu=1, force=force), tmp_path)
    held = found[1, "0_box"]
    assert held.needed_n == pytest.approx(mass * 9.81, rel=1e-3)
    assert held.available_n == pytest.approx(2 * force, rel=1e-2)
    assert held.friction_needed == pytest.approx(mass * 9.81 / (2 * force), rel=1e-2)
    other = found[0, "1_box"]
    assert other.needed_n is None  # its base is fixed: by what, nobody knows
    assert other.impulse_n_s == pytest.approx([-x for x in held.impulse_n_s], abs=1e-9)
    assert other.energy_of_pair_j == held.energy_of_pair_j


def test_normals_that_share_no_line_have_no_need(tmp_path: Path) -> None:
    scene = (
        FLOOR
        + BOX
        + """
box(0, [0, .5, .2], (.5, .05, .5))
box(0, [0, .05, .01], (.5, .4, .01), turned=[-.6, 0, 0])
b = ball(1, [0, .3, .4])
steps(480)
"""
    )
    found = touches(scene, tmp_path)
    ball = [each for (number, _), each in found.items() if number == 3]
    assert ball
    assert all(each.friction_needed is not None for each in ball)
    corner = (
        FLOOR
        + BOX
        + """
for s in (-1, 1):
    box(0, [0, .4 * s, .3], (.5, .3, .01), turned=[.6 * s, 0, 0])
b = box(1, [0, 0, .5], (.05, .05, .05), turned=[.78, 0, 0])
steps(240)
"""
    )
    found = touches(corner, tmp_path)
    assert all(each.steps for each in found.values())


def test_a_robot_stands(tmp_path: Path) -> None:
    scene = FLOOR + 'b = p.loadURDF("laikago/laikago_toes_zup_lores.urdf", [0, 0, .5])\nsteps(300)'
    found = touches(scene, tmp_path)
    robot, floor = found[1, "0_plane"], found[0, "1_laikago_toes_zup_lores"]
    assert robot.impulse_n_s == pytest.approx([-each for each in floor.impulse_n_s])
    assert floor.energy_j == 0
    assert robot.friction == 1
    assert robot.friction_needed is not None
    assert robot.friction_needed < 0.1


@pytest.mark.parametrize(
    "scene",
    some(
        [
            SLOPE.format(degrees=25, mu=0.3, above=0.02, steps=100),
            PUCK,
            LIFT.format(mass=1, mu=0.2, force=10),
        ],
        1,
    ),
)
def test_pieces_come_to_the_same(scene: str, tmp_path: Path) -> None:
    whole, pieces = touches(scene, tmp_path), touches(scene, tmp_path, 7)
    assert whole.keys() == pieces.keys()
    for key, one in whole.items():
        other = pieces[key]
        assert other.steps == one.steps
        for name in (
            "friction",
            "used",
            "available_n",
            "needed_n",
            "friction_needed",
            "slid_m",
            "deepest_m",
            "impulse_n_s",
            "energy_j",
            "energy_of_pair_j",
        ):
            value = getattr(one, name)
            expected = None if value is None else pytest.approx(value, rel=1e-9, abs=1e-12)
            assert getattr(other, name) == expected


def test_the_velocities_of_points_matter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If the spin's contribution is ignored, a rolling ball seems to slide."""
    scene = FLOOR + BOX + "b = ball(1, [0, 0, .1])\np.resetBaseVelocity(b, [1, 0, 0], [0, 10, 0])\n"
    rolls = touches(scene + "steps(100)", tmp_path)[1, "0_plane"]
    assert rolls.slid_m < 5e-3

    def without_spin(kin: Kinematics, velocity: NDArray[np.float64]) -> LinkVelocities:
        moved = motion(kin, velocity)
        return moved._replace(spins=[0 * spin for spin in moved.spins])

    monkeypatch.setattr(contact_points, "motion", without_spin)
    assert touches(scene + "steps(100)", tmp_path)[1, "0_plane"].slid_m > 0.3

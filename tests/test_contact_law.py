"""Verification: the contact model follows PyBullet's converged solver through impact and rest.

Its predictions of bounces are checked against e^(2k) h. The solver is made to converge
(`solverResidualThreshold=0`); the effect of its default is asserted too, with its sign and size.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from conftest import some
from drop_physics.engines.pybullet.world import World
from drop_physics.physics.laws.bullet import contact as bullet_contact
from drop_physics.physics.laws.bullet.air import effective_damping
from drop_physics.physics.laws.bullet.law import BulletLaw
from drop_physics.scenario import Scenario
from drop_physics.trace.states import BODY
from engine import MODES, drive
from iterated import airborne, law_of

MASS_KG, REST_HEIGHT_M = 0.1, 0.025
CONVERGED = {"solverResidualThreshold": 0}


@dataclass(frozen=True)
class Dropped:
    """A box, and its release conditions."""

    height_m: float
    gravity_m_s2: float
    linear_damping: float | None
    coordinates: Any
    velocity_m_s: float = 0.0

    def law(self, rate: float, substeps: int = 1) -> BulletLaw:
        """Return the contact model for a number of steps per second."""
        return law_of(
            timestep_s=1 / rate,
            substeps=substeps,
            gravity_m_s2=self.gravity_m_s2,
            mass_kg=MASS_KG,
            linear_damping=self.linear_damping,
            coordinates=self.coordinates,
        )


def dropped(
    fall: Dropped,
    *,
    timestep_s: float,
    steps: int,
    restitution: float | None = None,
    **engine: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return heights and vertical velocities of cube_small.urdf above plane.urdf."""
    damping = effective_damping(fall.linear_damping, fall.coordinates)
    seen = drive(
        timestep_s=timestep_s,
        samples=steps + 1,
        gravity_m_s2=fall.gravity_m_s2,
        height_m=fall.height_m,
        velocity_m_s=(0.0, 0.0, fall.velocity_m_s),
        coordinates=fall.coordinates,
        restitution=restitution,
        dynamics={"linearDamping": damping},
        engine=engine,
    )
    return seen.position_m[:, 2], seen.velocity_m_s[:, 2]


def fall_of(
    gravity_m_s2: float = -9.81, linear_damping: float | None = None, coordinates: Any = "reduced"
) -> Dropped:
    height_m = 1.0 if gravity_m_s2 < -5 else 0.5
    return Dropped(height_m, gravity_m_s2, linear_damping, coordinates)


def predicted(
    fall: Dropped, rate: float, steps: int, *, substeps: int = 1, **contact: Any
) -> tuple[np.ndarray, np.ndarray]:
    path = bullet_contact.flat_drop(
        fall.law(rate, substeps),
        height_m=fall.height_m,
        velocity_m_s=fall.velocity_m_s,
        rest_height_m=REST_HEIGHT_M,
        **contact,
    )
    heights, velocities = np.array([*itertools.islice(path, steps + 1)]).T
    return heights, velocities


class Bounce(NamedTuple):
    """A contact followed by flight: the last sample before it, effective restitution, apex."""

    step: int
    restitution: float
    apex_m: float


def bounces_of(series: tuple[np.ndarray, np.ndarray], fall: Dropped, rate: int) -> list[Bounce]:
    heights_m, velocities_m_s = series
    below = np.concatenate(([False], heights_m <= REST_HEIGHT_M, [False]))
    starts, ends = np.flatnonzero(np.diff(below.astype(np.int8))).reshape(-1, 2).T
    bounces = []
    for start, end, following in zip(starts, ends, [*starts[1:], len(heights_m)], strict=False):
        if end < len(heights_m):
            falling = (0, 0, velocities_m_s[start])
            approach_m_s = -bullet_contact.free_velocity(fall.law(rate), falling)
            rebound_m_s = velocities_m_s[start + 1 : end + 1].max()
            apex_m = heights_m[end:following].max() - REST_HEIGHT_M
            bounces.append(Bounce(int(start), rebound_m_s / approach_m_s, apex_m))
    return bounces


# -- against PyBullet ------------------------------------------------------------------------------


@pytest.mark.parametrize("coordinates", some(MODES, 3))
@pytest.mark.parametrize("rate", [60, 240, 960])
@pytest.mark.parametrize("restitution", [0.0, 0.9])
def test_the_whole_second_is_pybullets(coordinates: Any, rate: int, restitution: float) -> None:
    # Each body has the restitution; the pair's is the product. Bounces that differ in a last place
    # may see the floor's distance off by 2^-50 m, which is a speed of 2^-50 m / dt for 1 s.
    grain_m = 2**-50 * rate if restitution else 0.0
    for erp, (gravity, k) in itertools.product((0.0, 0.08, 0.2), ((-9.81, None), (-1.62, 0.0))):
        fall = fall_of(gravity, k, coordinates)
        heights, velocities = dropped(
            fall,
            timestep_s=1 / rate,
            steps=rate,
            restitution=restitution,
            contactERP=erp,
            **CONVERGED,
        )
        law = predicted(fall, rate, rate, restitution=restitution**2, contact_erp=erp)
        assert np.abs(law[0] - heights).max() <= 1e-13 + grain_m
        assert np.abs(law[1] - velocities).max() <= (1e-13 + grain_m) * rate


@pytest.mark.parametrize("coordinates", MODES)
@pytest.mark.parametrize("substeps", [1, 3, 10])
@pytest.mark.parametrize("threshold_m_s", [0.0, 1.0, 4.0])
def test_threshold_and_substeps_are_pybullets(
    coordinates: Any, substeps: int, threshold_m_s: float
) -> None:
    fall, rate = fall_of(coordinates=coordinates), 240
    heights, velocities = dropped(
        fall,
        timestep_s=1 / rate,
        steps=rate,
        restitution=0.9,
        numSubSteps=substeps,
        restitutionVelocityThreshold=threshold_m_s,
        **CONVERGED,
    )
    law = predicted(
        fall,
        rate,
        rate,
        restitution=0.9**2,
        restitution_threshold_m_s=threshold_m_s,
        substeps=substeps,
    )
    grain_m = 2**-50 * rate * substeps
    assert np.abs(law[0] - heights).max() <= 1e-13 + grain_m
    assert np.abs(law[1] - velocities).max() <= (1e-13 + grain_m) * rate * substeps


def test_the_floor_of_our_own_worlds_is_the_laws() -> None:
    """The floor is a btMultiBody in maximal coordinates too, which decides the contact solver."""
    scenario = Scenario(
        coordinates="maximal", restitution=0.9, solver_residual=0.0, timestep_s=1 / 60
    )
    with World(scenario) as world:
        (samples,) = world.samples(1000)
    fall = fall_of(coordinates="maximal")
    heights, _ = predicted(fall, 60, 60, restitution=0.9**2)
    assert np.abs(heights - samples.bases[BODY][:, 2]).max() <= 1e-13 + 2**-50 * 60


@pytest.mark.parametrize("coordinates", MODES)
def test_contact_begins_where_the_body_just_touches(coordinates: Any) -> None:
    """At a gap of exactly 0 the engine holds the body; 1e-15 m above the floor it falls."""
    for height_m, velocity_m_s in (
        (REST_HEIGHT_M, -bullet_contact.CONTACT_SLOP_M * 240),  # it may sink by the slop
        (REST_HEIGHT_M + 1e-15, -9.81 / 240),
    ):
        fall = replace(fall_of(coordinates=coordinates), height_m=height_m)
        _, engine = dropped(fall, timestep_s=1 / 240, steps=1, **CONVERGED)
        _, law = predicted(fall, 240, 1)
        assert engine[1] == pytest.approx(velocity_m_s, abs=1e-14)
        assert law[1] == pytest.approx(velocity_m_s, abs=1e-14)


@pytest.mark.parametrize("coordinates", MODES)
def test_a_body_as_fast_as_the_threshold_bounces_and_one_a_bit_slower_does_not(
    coordinates: Any,
) -> None:
    """Thrown down without gravity, the body arrives at its release speed."""
    threshold_m_s = bullet_contact.RESTITUTION_THRESHOLD_M_S
    for speed_m_s, bounces in ((threshold_m_s, True), (np.nextafter(threshold_m_s, 0), False)):
        fall = Dropped(0.05, 0.0, 0.0, coordinates, velocity_m_s=-speed_m_s)
        _, engine = dropped(fall, timestep_s=1 / 240, steps=120, restitution=0.9, **CONVERGED)
        _, law = predicted(fall, 240, 120, restitution=0.81)
        assert np.abs(law - engine).max() < 1e-13
        assert (law[-1] > 0.7 * speed_m_s) == bounces
        assert bullet_contact.rebound_speed(-speed_m_s, 0.5) == (0.5 * speed_m_s if bounces else 0)


def test_the_lowest_points_are_the_golden_ones() -> None:
    heights, _ = predicted(fall_of(), 240, 240)
    assert np.argmin(heights) == 108
    assert heights[108] == pytest.approx(0.01618091982485528, abs=1e-15)
    undamped, _ = predicted(fall_of(linear_damping=0.0), 240, 240)
    assert np.argmin(undamped) == 107
    assert undamped[107] == pytest.approx(0.015934374999998453, abs=1e-15)


def test_rest_is_the_slop_below_the_floor_and_the_solver_stops_earlier() -> None:
    # -11.98 µm at 1 s = -10.00 slop - 1.84 early exit of the solver - 0.15 not yet settled
    settled, _ = predicted(fall_of(), 240, 100_000)
    assert settled[-1] - REST_HEIGHT_M == pytest.approx(-bullet_contact.CONTACT_SLOP_M, abs=1e-15)
    assert settled[240] - settled[-1] == pytest.approx(-0.15e-6, abs=0.005e-6)
    engine, _ = dropped(fall_of(), timestep_s=1 / 240, steps=240)
    assert engine[240] - settled[240] == pytest.approx(-1.84e-6, abs=0.01e-6)


@pytest.mark.parametrize("coordinates", MODES)
def test_the_air_is_the_law_of_the_air(coordinates: Any) -> None:
    fall = fall_of(coordinates=coordinates)
    heights, velocities = predicted(fall, 240, 100)
    position_m, velocity_m_s = airborne(fall.law(240), 100)
    assert (heights == position_m[:, 2]).all()
    assert (velocities == velocity_m_s[:, 2]).all()


@pytest.mark.parametrize("coordinates", MODES)
def test_a_long_rest_repeats_exactly_and_costs_nothing(coordinates: Any) -> None:
    fall = fall_of(coordinates=coordinates)
    short, long = predicted(fall, 240, 20_000), predicted(fall, 240, 1_000_000)
    for few, many in zip(short, long, strict=True):
        assert (many[:20_001] == few).all()
    assert np.ptp(long[0][10_000:]) < 1e-15


# -- bounces ---------------------------------------------------------------------------------------


def test_rebounds_reach_e_squared_of_the_height_each_time() -> None:
    # e² h, e⁴ h, e⁶ h
    assert bullet_contact.rebound_heights(0.8, 0.5, 3) == pytest.approx(
        [0.2, 0.05, 0.0125], rel=1e-15
    )
    assert bullet_contact.rebound_heights(1.0, 0.0, 2).tolist() == [0, 0]


def test_no_rebound_below_the_threshold_or_upwards() -> None:
    assert bullet_contact.rebound_speed(-1.0, 0.5) == 0.5
    assert bullet_contact.rebound_speed(-0.1999, 0.5) == 0
    assert bullet_contact.rebound_speed(1.0, 0.5) == 0
    assert bullet_contact.rebound_speed(-1.0, 0.5, threshold_m_s=1.0) == 0.5
    assert bullet_contact.rebound_speed(-1.0, 0.5, threshold_m_s=1.1) == 0


@pytest.mark.parametrize("coordinates", MODES)
def test_without_position_correction_restitution_is_as_given(coordinates: Any) -> None:
    fall = fall_of(linear_damping=0.0, coordinates=coordinates)
    series = predicted(fall, 960, 960, restitution=0.5, contact_erp=0.0)
    first, *_ = bounces_of(series, fall, 960)
    assert first.restitution == pytest.approx(0.5, abs=1e-15)
    assert series[0][first.step] > REST_HEIGHT_M or series[1][first.step] < 0
    assert series[0][first.step - 1] > REST_HEIGHT_M >= series[0][first.step]


def test_without_position_correction_bounces_converge_to_theory() -> None:
    # The step quantises the impact: first order, within v dt of the rebound height.
    fall = fall_of(linear_damping=0.0)
    expected = bullet_contact.rebound_heights(fall.height_m - REST_HEIGHT_M, 0.5, 2)
    for rate in (960, 96_000):
        series = predicted(fall, rate, int(1.2 * rate), restitution=0.5, contact_erp=0.0)
        apexes_m = [bounce.apex_m for bounce in bounces_of(series, fall, rate)[:2]]
        assert np.abs(apexes_m - expected).max() < 5 / rate


def test_position_correction_inflates_restitution() -> None:
    # e + erp f, 0 <= f < 1: at any timestep
    fall = fall_of()
    for rate in (240, 960, 9600):
        first = bounces_of(predicted(fall, rate, rate, restitution=0.5), fall, rate)[0]
        assert 0.5 < first.restitution <= 0.5 + bullet_contact.CONTACT_ERP


def test_the_bounces_found_in_the_engines_heights_are_the_laws() -> None:
    fall = fall_of()
    recorded = dropped(fall, timestep_s=1 / 480, steps=480, restitution=math.sqrt(0.5), **CONVERGED)
    law = predicted(fall, 480, 480, restitution=0.5)
    for seen, expected in zip(
        bounces_of(recorded, fall, 480), bounces_of(law, fall, 480), strict=True
    ):
        assert seen.step == expected.step
        assert seen.apex_m == pytest.approx(expected.apex_m, abs=1e-12)


def test_without_restitution_only_position_correction_bounces() -> None:
    # Position correction alone returns up to its 8 % of the penetration per step.
    fall = fall_of()
    assert bounces_of(predicted(fall, 240, 480, contact_erp=0.0), fall, 240) == []
    assert all(
        bounce.restitution < 0.08 for bounce in bounces_of(predicted(fall, 240, 480), fall, 240)
    )
    assert bounces_of(predicted(fall, 240, 50), fall, 240) == []  # still in the air

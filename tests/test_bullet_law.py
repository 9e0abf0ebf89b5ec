"""Verification: the integration rule is PyBullet's, bit for bit, and so is its exact version.

On x86-64 the engine rounds once per operation, and equality is asserted. On other machines a
compiler may fuse multiply and add: there 1e-12 is allowed, some thousand roundings of a metre.
"""

from __future__ import annotations

import itertools
from decimal import Decimal
from typing import Any

import numpy as np
import pytest
from conftest import some
from drop_physics.physics import theory
from drop_physics.physics.base import ExactPath, exactly
from drop_physics.physics.laws.bullet import air as bullet_air
from drop_physics.physics.laws.bullet.air import effective_damping
from drop_physics.physics.laws.bullet.law import BulletLaw
from drop_physics.physics.laws.lookup import fall_of
from drop_physics.scenario import Scenario
from engine import MODES, ROUNDS_ONCE, drive
from iterated import airborne, law_of, thrown_as


def thrown(
    *,
    steps: int,
    linear_damping: float | None = None,
    mass_kg: float | None = None,
    **how: Any,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the positions, the velocities and the mass of a body in a world without a floor."""
    settings = {"linearDamping": linear_damping, "mass": mass_kg}
    dynamics = {name: value for name, value in settings.items() if value is not None}
    seen = drive(samples=steps + 1, floor=False, dynamics=dynamics, **how)
    return seen.position_m, seen.velocity_m_s, seen.mass_kg


def exact_path(law: BulletLaw, *, steps: int, velocity_m_s: Any = (0.0, 0.0, 0.0)) -> ExactPath:
    start_m = (0.0, 0.0, 1.0)
    return exactly(law.exact_path(start_m, velocity_m_s), steps + 1, start_m)


def assert_same(actual: np.ndarray, expected: np.ndarray) -> None:
    if ROUNDS_ONCE:
        np.testing.assert_array_equal(actual, expected)
    else:
        np.testing.assert_allclose(actual, expected, rtol=1e-12, atol=1e-12)


# -- by hand ---------------------------------------------------------------------------------------


def test_three_steps_by_hand() -> None:
    # dt = 0.1, g = -10, k = 0.04, from rest at 1: v first, then z with the new v
    #   v1 = -1                                          z1 = 1      - 0.1           = 0.9
    #   v2 = -1     - 1 + 0.1 x 0.04 x 1     x 2         z2 = 0.9    - 0.1992        = 0.7008
    #   v3 = -1.992 - 1 + 0.1 x 0.04 x 1.992 x 2.992     z3 = 0.7008 - 0.2968159744  = 0.4039840256
    law = law_of(timestep_s=0.1, gravity_m_s2=-10.0, linear_damping=0.04)
    position_m, velocity_m_s = airborne(law, 3)
    assert position_m[:, 2] == pytest.approx([1, 0.9, 0.7008, 0.4039840256], abs=1e-15)
    assert velocity_m_s[:, 2] == pytest.approx([0, -1, -1.992, -2.968159744], abs=1e-15)
    assert not position_m[:, :2].any()
    exact = exact_path(law, steps=3)
    assert exact.nearest_m[:, 2] == pytest.approx([1, 0.9, 0.7008, 0.4039840256], abs=1e-15)


def test_three_maximal_steps_by_hand() -> None:
    # dt = 1, k = 0.5, g = -1, from 4 m/s: v halves, then falls by 1: 4, 1, -0.5, -1.25
    how: Any = {"timestep_s": 1.0, "mass_kg": 2.0, "coordinates": "maximal"}
    law = law_of(gravity_m_s2=-1.0, linear_damping=0.5, **how)
    position_m, velocity_m_s = airborne(law, 3, velocity_m_s=(0, 0, 4.0))
    assert velocity_m_s[:, 2].tolist() == [4, 1, -0.5, -1.25]
    assert position_m[:, 2].tolist() == [1, 2, 1.5, 0.25]


# -- against PyBullet ------------------------------------------------------------------------------

GRID = list(
    itertools.product(
        (1 / 60, 1 / 240, 1 / 1000),
        (
            (0.0, 0.0, 0.0),
            (0.0, 0.0, 5.3),
            (0.0, 0.0, -150.0),
            (1.0, 2.0, 3.0),
            (30.0, -120.0, 2.0),
        ),
        ((-9.81, None), (0.0, 0.3), (3.7, 1e-3), (-9.81, 49.0)),  # 1 / (1 / 49) is not 49.
    )
)[::3]
"""A third of all combinations, in which every pair of values of different parameters occurs."""


@pytest.mark.parametrize("coordinates", some(MODES, 2))
@pytest.mark.parametrize("linear_damping", [None, 0.0, 0.5, 1.5])
def test_the_law_is_pybullets(coordinates: Any, linear_damping: float | None) -> None:
    for dt, velocity, (gravity, mass) in GRID:
        setting: Any = {
            "gravity_m_s2": gravity,
            "linear_damping": linear_damping,
            "coordinates": coordinates,
            "timestep_s": dt,
        }
        positions, velocities, mass_kg = thrown(
            steps=30, mass_kg=mass, velocity_m_s=velocity, **setting
        )
        law = law_of(mass_kg=mass_kg, **setting)
        predicted = airborne(law, 30, velocity_m_s=velocity)
        assert_same(predicted[0], positions)
        assert_same(predicted[1], velocities)
        many = law.held(law.free_velocities(velocities[:-1]))
        # Each of its few operations rounds the largest of what it adds.
        largest = np.abs(velocities).max() + abs(gravity) * dt
        assert np.abs(many - velocities[1:]).max() <= 8 * np.spacing(largest)
        exact = exact_path(law, steps=30, velocity_m_s=velocity)
        rounding = exact.difference(positions)
        # Each step rounds the height and the velocity once more, by half a last place at most.
        steps = np.arange(31)[:, None]
        in_height = np.spacing(np.abs(positions).max())
        in_velocity = np.spacing(np.abs(velocities).max()) * steps * dt
        assert (np.abs(rounding) <= steps * (in_height + 2 * in_velocity)).all()


@pytest.mark.parametrize("coordinates", MODES)
def test_damping_is_taken_as_the_engine_takes_it(coordinates: Any) -> None:
    # Negative values are ignored; values above 1 are clamped in maximal coordinates only.
    default = {"reduced": 0.03999999910593033, "maximal": 0.0}[coordinates]
    assert effective_damping(None, coordinates) == effective_damping(-0.3, coordinates) == default
    assert effective_damping(3.0, coordinates) == {"reduced": 3.0, "maximal": 1.0}[coordinates]
    for given in (-0.3, 0.04, 3.0):
        seen, _, mass_kg = thrown(steps=50, linear_damping=given, coordinates=coordinates)
        law = law_of(linear_damping=given, coordinates=coordinates, mass_kg=mass_kg)
        assert_same(airborne(law, 50)[0], seen)
    assert effective_damping(0.04, "reduced") != effective_damping(None, "reduced")


@pytest.mark.parametrize("coordinates", MODES)
def test_velocity_is_limited_in_reduced_coordinates_only(coordinates: Any) -> None:
    setting: Any = {"linear_damping": 0.0, "coordinates": coordinates}
    fast: Any = {"velocity_m_s": (0.0, 130.0, -99.99)}
    _, velocities, mass_kg = thrown(steps=3, **fast, **setting)
    _, predicted = airborne(law_of(mass_kg=mass_kg, **setting), 3, **fast)
    assert_same(predicted, velocities)
    limited = coordinates == "reduced"
    assert (np.abs(predicted[1:]).max() == bullet_air.MAX_COORDINATE_VELOCITY_M_S) == limited


@pytest.mark.parametrize("velocity_m_s", [(0.0, 0.0, 1e-9), (1e-9, 0.0, -1e-9), (0.0, 0.0, 2e-8)])
def test_a_body_that_barely_moves_has_no_speed(velocity_m_s: Any) -> None:
    # safeNorm takes a squared length up to 2.2e-16 for zero: there the drag is only linear.
    setting: Any = {"gravity_m_s2": 0.0, "linear_damping": 0.5}
    _, velocities, mass_kg = thrown(steps=50, velocity_m_s=velocity_m_s, **setting)
    _, predicted = airborne(law_of(mass_kg=mass_kg, **setting), 50, velocity_m_s=velocity_m_s)
    assert_same(predicted, velocities)


@pytest.mark.parametrize("coordinates", MODES)
def test_spin_moves_a_fall_by_rounding_only(coordinates: Any) -> None:
    how: Any = {"velocity_m_s": (1.0, 2.0, 3.0)}
    seen, _, mass_kg = thrown(
        steps=200, spin_rad_s=(20.0, -3.0, 7.0), coordinates=coordinates, **how
    )
    unspun, _ = airborne(law_of(coordinates=coordinates, mass_kg=mass_kg), 200, **how)
    assert np.abs(unspun - seen).max() <= (1e-14 if coordinates == "reduced" else 0)


# -- golden values ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rate", "linear_damping", "z_m", "v_m_s"),
    [
        (240, None, 0.5567296523863766, -2.892568262058582),
        (480, None, 0.5597951433403751, None),
        (960, None, 0.5613277333771846, None),
        (240, 0.0, 0.5524187499999997, -2.943000000000005),
        (480, 0.0, 0.5554843749999994, None),
        (960, 0.0, 0.5570171875000008, None),
    ],
)
def test_the_law_gives_the_golden_values_at_0_3_s(
    rate: int, linear_damping: float | None, z_m: float, v_m_s: float | None
) -> None:
    steps = 3 * rate // 10
    law = law_of(linear_damping=linear_damping, timestep_s=1 / rate)
    position_m, velocity_m_s = airborne(law, steps)
    assert_same(position_m[-1, 2], np.float64(z_m))
    if v_m_s is not None:
        assert_same(velocity_m_s[-1, 2], np.float64(v_m_s))


def test_the_law_gives_the_golden_values_at_1_s() -> None:
    for gravity_m_s2, z_m in ((-9.81, -3.5783295613954387), (-1.62, 0.2056535771354357)):
        position_m, _ = airborne(law_of(gravity_m_s2=gravity_m_s2), 240)
        assert_same(position_m[-1, 2], np.float64(z_m))


@pytest.mark.parametrize(
    ("rate", "total", "interaction"),
    [
        (240, -0.001820347613623, 6.8255e-7),
        (480, 0.001245143340375, 5.4851e-7),
        (960, 0.002777733377185, 3.2604e-7),
    ],
)
def test_the_error_budget_at_0_3_s(rate: int, total: float, interaction: float) -> None:
    law, steps = law_of(timestep_s=1 / rate), 3 * rate // 10
    fall, time_s = thrown_as(law), np.arange(steps + 1) / rate
    exact = exact_path(law, steps=steps)
    simulated_m = airborne(law, steps)[0]
    free_m = theory.free_fall_position(fall, time_s)
    terms = theory.timestep_displacement(fall, time_s, 1 / rate)
    terms += theory.damping_displacement(fall, time_s)
    assert (simulated_m - free_m)[-1, 2] == pytest.approx(total, abs=1e-15)
    left = -exact.difference(free_m + terms)
    assert left[-1, 2] == pytest.approx(interaction, abs=5e-12)
    assert np.abs(exact.difference(simulated_m)).max() <= 6e-16


# -- exact arithmetic ------------------------------------------------------------------------------


def test_exact_heights_hold_thirty_digits() -> None:
    # Without damping the law is a polynomial: z = 1 + g dt² n (n + 1)/2
    exact = exact_path(law_of(linear_damping=0.0), steps=100)
    dt, g = map(Decimal, (1 / 240, -9.81))
    for n in (1, 50, 100):
        expected = 1 + g * dt * dt * n * (n + 1) / 2
        held = Decimal(exact.nearest_m[n, 2]) + Decimal(exact.left_out_m[n, 2])
        assert abs(held - expected) < Decimal("1e-26")  # 28 digits is Decimal's default
        assert exact.nearest_m[n, 2] == float(expected)


def test_exact_paths_go_sideways_too() -> None:
    # Maximal coordinates have no drag by default: x = x0 + v t, from any start.
    law = law_of(coordinates="maximal")
    start_m = (1.0, -2.0, 3.0)
    exact = exactly(law.exact_path(start_m, (0.1, 0.3, 0.0), first=100), 1, start_m)
    dt = Decimal(1 / 240)
    for axis, start, speed in ((0, 1.0, 0.1), (1, -2.0, 0.3)):
        held = Decimal(exact.nearest_m[0, axis]) + Decimal(exact.left_out_m[0, axis])
        assert abs(held - (Decimal(start) + 100 * dt * Decimal(speed))) < Decimal("1e-26")


def test_difference_sees_less_than_the_last_place() -> None:
    exact = exact_path(law_of(), steps=10)
    assert (exact.difference(exact.nearest_m) == -exact.left_out_m).all()
    left_m = np.abs(exact.left_out_m[:, 2])
    assert 0 < left_m[1:].min() < left_m.max() < 6e-17


@pytest.mark.parametrize("coordinates", MODES)
@pytest.mark.parametrize("velocity_m_s", [(0.0, 0.0, 2.0), (3.0, -1.0, 2.0)])
def test_the_law_converges_to_theory(coordinates: Any, velocity_m_s: Any) -> None:
    # First order: halving the timestep halves the distance to the damped fall, along every axis.
    errors = []
    for rate in (1000, 2000):
        law = law_of(linear_damping=0.3, coordinates=coordinates, timestep_s=1 / rate)
        exact = exact_path(law, steps=rate // 2, velocity_m_s=velocity_m_s)
        fall, at = thrown_as(law, velocity_m_s), np.array([0.5])
        damped_m = theory.free_fall_position(fall, at) + theory.damping_displacement(fall, at)
        errors.append((exact.nearest_m[-1] - damped_m[0])[np.array(velocity_m_s) != 0])
    assert errors[0] / errors[1] == pytest.approx(2, abs=5e-3)


# -- from a scenario -------------------------------------------------------------------------------


def test_fall_of_a_scenario() -> None:
    fall = fall_of(Scenario(height_m=2.0, velocity_m_s=(1.0, 0.0, 3.0)))
    assert fall == thrown_as(law_of(), (1.0, 0.0, 3.0), 2.0)
    assert fall_of(Scenario(gravity_set=False)).gravity_m_s2 == 0
    assert not any(fall_of(Scenario(coordinates="maximal")).drag)

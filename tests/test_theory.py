"""Verification: the closed forms solve their differential equations to the last digits.

The judge of the judge is arithmetic with 60 digits. The equations stand in `equation_solved`, as an
ODE that Taylor terms integrate; the closed form in `exact` is checked against it once, and then
serves as the reference for everything along a line, because it is fast.
"""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from conftest import some
from drop_physics.physics import theory
from drop_physics.physics.base import Drag
from drop_physics.physics.laws.bullet.law import drag_of
from drop_physics.physics.theory import TheoreticalFall

DEFAULT = float(np.float32(0.04))
TIMES_S = np.array([1e-6, 1e-3, 0.01, 0.05, 0.1, 0.3, 0.5, 0.77, 1.0])
LATE_S = np.array([2.0, 3.7, 10.0, 100.0, 1000.0])


@pytest.fixture(autouse=True)
def _sixty_digits() -> Any:
    with mp.workdps(60):
        yield


def fall(
    k: float = DEFAULT, g: float = -9.81, v: Any = 0.0, mode: Any = "reduced"
) -> TheoreticalFall:
    velocity = (0.0, 0.0, float(v)) if np.isscalar(v) else tuple(v)
    return TheoreticalFall(
        position_m=(0.0, 0.0, 1.0), velocity_m_s=velocity, gravity_m_s2=g, drag=drag_of(k, mode)
    )


def damping_m(thrown: TheoreticalFall, time_s: Any) -> Any:
    """Return the vertical component of the damping's displacement."""
    return theory.damping_displacement(thrown, time_s)[:, 2]


def exact(k: float, g: float, v0: float, t: float) -> tuple[Any, Any]:
    """Return path and deviation from free fall: ln(ψ)/b on each side of the apex."""
    k, g, v0, t = map(mp.mpf, (k, g, v0, t))

    def leg(b: Any, v: Any, t: Any) -> Any:
        w = mp.sqrt(k * k / 4 + b * g)
        psi = mp.cosh(w * t) + (k / 2 + b * v) * (mp.sinh(w * t) / w if w else t)
        return (mp.log(mp.re(psi)) - k * t / 2) / b

    b = k * mp.sign(v0 or g)
    apex = mp.inf
    if v0 * g < 0:
        w, r = mp.sqrt(k * k / 4 + b * g), -v0 / (g - k * v0 / 2)
        apex = mp.re(mp.atanh(w * r) / w) if w else r
    way = leg(b, v0, min(t, apex)) + (leg(-b, mp.mpf(0), t - apex) if t > apex else 0)
    return way, way - v0 * t - g * t * t / 2


def equation_solved(
    k: float,
    g: float,
    velocity: tuple[float, float, float],
    until_s: float,
    quadratic: float | None = None,
) -> tuple[list[Any], list[Any]]:
    """Return δ and δ' of δ'' = -v (a + b |v|), v = v_free + δ', by 40 Taylor terms per step."""
    a, b = mp.mpf(k), mp.mpf(k if quadratic is None else quadratic)
    g, order = mp.mpf(g), 40
    steps = math.ceil(until_s * (3 + math.hypot(*velocity)) / 0.5)  # well within convergence
    h = mp.mpf(until_s) / steps
    change, rate = [mp.mpf(0)] * 3, [mp.mpf(0)] * 3
    for step in range(steps):
        w = [[r] for r in rate]
        v = [[velocity[i] + rate[i] + (g * step * h if i == 2 else 0)] for i in range(3)]
        speed: list[Any] = []
        for n in range(order):
            square = sum(c[j] * c[n - j] for c in v for j in range(n + 1))
            known = sum(speed[j] * speed[n - j] for j in range(1, n))
            speed.append((square - known) / (2 * speed[0]) if n else mp.sqrt(square))
            for i in range(3):
                product = sum(v[i][j] * speed[n - j] for j in range(n + 1))
                w[i].append(-(a * v[i][n] + b * product) / (n + 1))
                v[i].append(w[i][-1] + (g if (i, n) == (2, 0) else 0))
        change = [
            c + sum(w[i][n] * h ** (n + 1) / (n + 1) for n in range(order))
            for i, c in enumerate(change)
        ]
        rate = [sum(w[i][n] * h**n for n in range(order)) for i in range(3)]
    return change, rate


def error(value: float, reference: Any) -> float:
    return abs(float(mp.mpf(float(value)) - reference))


# -- the reference itself, and the figures of the experiment ---------------------------------------


@pytest.mark.parametrize(("g", "v0"), [(-9.81, -1.0), (3.7, 2.0), (0.0, 5.0), (-9.81, 4.0)])
def test_the_reference_solves_the_equation(g: float, v0: float) -> None:
    change, _ = equation_solved(DEFAULT, g, (0, 0, v0), 0.3)
    assert abs(exact(DEFAULT, g, v0, 0.3)[1] - change[2]) < 1e-30


def test_the_closed_forms_give_the_figures_of_the_experiment() -> None:
    at = np.array([0.3])
    assert theory.free_fall_height(fall(), at) == pytest.approx(0.55855, abs=1e-15)
    assert damping_m(fall(), at) == pytest.approx(0.004310219835131, abs=5e-16)
    assert theory.impact_time_free(fall(), 0.025) == pytest.approx(0.4458438722, abs=5e-11)
    damped_s = theory.impact_time_damped(fall(), 0.025)
    assert damped_s == pytest.approx(0.4500868681, abs=5e-11)
    speed = -theory._motion(fall(), np.array([damped_s])).velocity[0, 2]
    assert speed == pytest.approx(4.26445, abs=5e-6)


# -- free fall -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("g", "v0", "dt"), [(-9.81, 0.0, 1 / 240), (1.62, -3.0, 1 / 60)])
def test_timestep_term_is_exact_and_signed(g: float, v0: float, dt: float) -> None:
    # z_n - z_free = +g t dt/2, g signed: below free fall where gravity pulls down
    z, v = Fraction(1), Fraction(v0)
    for step in range(1, 73):
        v += Fraction(g) * Fraction(dt)
        z += v * Fraction(dt)
        t = step * Fraction(dt)
        off = z - (1 + Fraction(v0) * t + Fraction(g) * t * t / 2)
        term = theory.timestep_displacement(fall(0, g, v0), np.array([float(t)]), dt)[0, 2]
        assert abs(term - float(off)) <= 4 * math.ulp(float(off))


def test_no_damping_is_free_fall() -> None:
    thrown = fall(0.0, v=(1.0, 2.0, 3.0))
    assert (theory.damping_displacement(thrown, TIMES_S) == 0).all()
    free_m = theory.free_fall_height(thrown, TIMES_S)
    assert np.abs(theory.damped_fall_height(thrown, TIMES_S) - free_m).max() < 1e-15
    free_m_s = theory.free_fall_velocity(thrown, TIMES_S)
    assert (theory._motion(thrown, TIMES_S).velocity == free_m_s).all()


# -- drag along a line -----------------------------------------------------------------------------

SPEEDS_M_S = (0.0, -3.0, 5.0, 40.0, -120.0, -1e-7, 1e-3)


@pytest.mark.parametrize("k", some([1e-12, 1e-6, 1e-3, DEFAULT, 0.3, 1.0, 39.24], 3))
@pytest.mark.parametrize("g", [-9.81, -1.62, 0.0, 3.7])
def test_damping_displacement_keeps_its_digits_in_reduced_coordinates(k: float, g: float) -> None:
    # k = 39.24 = 4 g: there ω = 0 on the way up. g > 0 mirrors all of it.
    for v0 in SPEEDS_M_S:
        change_m = damping_m(fall(k, g, v0), np.append(TIMES_S, LATE_S))
        height_m = theory.damped_fall_height(fall(k, g, v0), np.append(TIMES_S, LATE_S))
        for t, change, height in zip((*TIMES_S, *LATE_S), change_m, height_m, strict=True):
            way, reference = exact(k, g, v0, t) if v0 or g else (mp.mpf(0), mp.mpf(0))
            if t <= 1:
                assert error(change, reference) <= 1e-13
            assert error(change, reference) <= 1e-12 * abs(float(reference))
            assert error(height, 1 + way) <= 4e-15 * max(1.0, abs(float(way)))


@pytest.mark.parametrize("k", [1e-12, 1e-6, DEFAULT, 0.5, 1 - 2**-53])
def test_damping_displacement_in_maximal_coordinates(k: float) -> None:
    for g, v0 in itertools.product((-9.81, 0.0, 3.7), (0.0, 5.0, -40.0)):
        change_m = damping_m(fall(k, g, (2, 0, v0), "maximal"), TIMES_S)
        for t, change in zip(TIMES_S, change_m, strict=True):
            rate, t = -mp.log1p(-mp.mpf(k)), mp.mpf(float(t))
            q = -mp.expm1(-rate * t) / rate
            reference = v0 * (q - t) + mp.mpf(g) * ((t - q) / rate - t * t / 2)
            assert error(change, reference) <= 1e-13 * abs(float(reference))


def test_damping_of_one_in_maximal_coordinates_stops_the_body() -> None:
    solid = fall(1.0, v=(2.0, 0.0, 3.0), mode="maximal")
    assert (theory.damped_fall_height(solid, np.array([0.0, 0.1, 7.0])) == 1).all()
    assert theory._motion(solid, np.array([0.0, 0.1])).velocity.tolist() == [[2, 0, 3], [0] * 3]
    assert theory.impact_time_damped(solid, 0.0) is None


def test_long_falls_reach_terminal_speed_without_overflow() -> None:
    # v_terminal = W - 1/2, W = sqrt(g/k + 1/4); 1e4 s is k W t = 6000
    terminal = math.sqrt(9.81 / DEFAULT + 0.25) - 0.5
    velocity = theory._motion(fall(v=60.0), np.array([1e4, 1e9])).velocity[:, 2]
    assert velocity == pytest.approx(-terminal, rel=1e-15)
    height = theory.damped_fall_height(fall(v=60.0), np.array([1e9, 1e9 + 1]))
    assert np.diff(height) == pytest.approx(-terminal, rel=1e-6)


@pytest.mark.parametrize("v", [0.0, 5.0, (3.0, -2.0, 4.0)])
@pytest.mark.parametrize("mode", ["reduced", "maximal"])
def test_upward_gravity_mirrors_the_fall(v: Any, mode: Any) -> None:
    down, up = fall(0.3, -9.81, v, mode), fall(0.3, 9.81, np.multiply(v, -1.0), mode)
    change = damping_m(down, TIMES_S)
    assert damping_m(up, TIMES_S) == pytest.approx(-change, rel=1e-13)


@pytest.mark.parametrize("v", [5.0, (3.0, -2.0, 4.0)])
def test_times_come_in_any_order_or_not_at_all(v: Any) -> None:
    mixed = np.array([0.9, 0.0, 0.3, 0.9, 1e-6])
    ordered, back = np.unique(mixed, return_inverse=True)
    change = damping_m(fall(v=v), ordered)
    assert damping_m(fall(v=v), mixed) == pytest.approx(change[back], rel=1e-12)
    assert damping_m(fall(v=v), np.array([])).shape == (0,)
    assert theory._motion(fall(v=v), np.array([])).velocity.shape == (0, 3)


# -- oblique throws --------------------------------------------------------------------------------


@pytest.mark.parametrize("k", some([1e-12, DEFAULT, 1.0], 2))
@pytest.mark.parametrize(("g", "v"), [(-9.81, (2, 0, 3)), (-9.81, (9, -7, 5)), (3.7, (1, 0, -2))])
def test_an_oblique_throw_solves_its_equation(
    k: float, g: float, v: tuple[float, float, float]
) -> None:
    times_s = np.array([1e-3, 0.7])
    change_m = theory.damping_displacement(fall(k, g, v), times_s)
    velocity_m_s = theory._motion(fall(k, g, v), times_s).velocity
    for t, change, velocity in zip(times_s, change_m, velocity_m_s, strict=True):
        delta, rate = equation_solved(k, g, v, float(t))
        for axis in range(3):
            assert error(change[axis], delta[axis]) <= 1e-12 * abs(float(delta[axis]))
            free = v[axis] + (mp.mpf(g) * float(t) if axis == 2 else 0)
            assert error(velocity[axis], free + rate[axis]) <= 1e-12


def test_oblique_without_gravity_keeps_its_line() -> None:
    change = damping_m(fall(0.3, 0.0, (3.0, 0.0, 4.0)), TIMES_S)
    along = damping_m(fall(0.3, 0.0, 5.0), TIMES_S)
    assert change == pytest.approx(0.8 * along, rel=1e-14)


def _drags(a: float, b: float, v: Any, g: float = -9.81) -> TheoreticalFall:
    return TheoreticalFall(
        position_m=(1.0, 2.0, 3.0), velocity_m_s=v, gravity_m_s2=g, drag=Drag(a, b)
    )


@pytest.mark.parametrize(("a", "b"), some([(0.0, 0.3), (0.2, 0.5), (1.0, 1e-3)], 1))
def test_the_two_drags_need_not_be_one_coefficient(a: float, b: float) -> None:
    # Rising straight, a body has no speed at its apex, where the Taylor terms of the speed end.
    cases = ((2.0, 0.0, 3.0), -9.81), ((0.0, 0.0, -3.0), -9.81), ((0.0, 0.0, 7.0), -9.81)
    for v, g in (*cases, ((1.0, 2.0, -2.0), 0.0)):
        reference, _ = equation_solved(a, g, v, 0.4, quadratic=b)
        (found,) = theory.damping_displacement(_drags(a, b, v, g), np.array([0.4]))
        for axis in range(3):
            assert error(found[axis], reference[axis]) <= 1e-12 * abs(float(reference[axis]))


def test_quadratic_drag_alone_lets_a_body_arrive() -> None:
    # Without gravity its way is ln(1 + b v t)/b: 2.975 m take (e^(b d) - 1)/(b v).
    time_s = theory.impact_time_damped(_drags(0.0, 0.5, (0.0, 0.0, -4.0), 0.0), 0.025)
    assert time_s == pytest.approx(math.expm1(0.5 * 2.975) / (0.5 * 4.0), rel=1e-13)


def test_almost_vertical_is_vertical() -> None:
    tilted, upright = fall(v=(1e-9, 0.0, 3.0)), fall(v=3.0)
    difference = np.subtract(*(theory.damped_fall_height(f, TIMES_S) for f in (tilted, upright)))
    assert np.abs(difference).max() < 1e-12


# -- impact ----------------------------------------------------------------------------------------

ARRIVE = [
    fall(), fall(v=5.0), fall(v=-5.0), fall(v=(3.0, 0.0, 5.0)), fall(1.0, -1e-3),
    fall(g=0.0, v=-5.0), fall(g=3.7, v=-2.8), fall(g=3.7, v=(1.0, 0.0, -2.8)), fall(mode="maximal"),
    fall(0.9, v=40.0, mode="maximal"),
]  # fmt: skip


@pytest.mark.parametrize("thrown", ARRIVE)
def test_impact_is_the_first_arrival(thrown: TheoreticalFall) -> None:
    for time_s, height in (
        (theory.impact_time_free(thrown, 0.025), theory.free_fall_height),
        (theory.impact_time_damped(thrown, 0.025), theory.damped_fall_height),
    ):
        assert time_s is not None
        before = height(thrown, np.linspace(0, time_s, 400)[:-1])
        assert (before > 0.025).all()
        rate = abs(theory._motion(thrown, np.array([time_s])).velocity[0, 2])
        assert height(thrown, np.array([time_s])) == pytest.approx(
            0.025, abs=4e-16 * (1 + abs(before).max() + rate * time_s)
        )


@pytest.mark.parametrize(
    ("thrown", "free"),
    [
        (fall(g=0.0), False),
        (fall(g=3.7), False),
        (fall(g=0.0, v=1.0), False),
        (fall(g=3.7, v=-2.6), False),  # turns at 8 cm
        (fall(g=3.7, v=-2.7), True),  # drag alone turns it before the floor
        (fall(1.0, 0.0, -1.0), True),  # drag alone stops it after ln 2
    ],
)
def test_what_never_arrives_has_no_time_of_impact(thrown: TheoreticalFall, free: bool) -> None:
    assert (theory.impact_time_free(thrown, 0.025) is not None) == free
    assert theory.impact_time_damped(thrown, 0.025) is None


def test_a_body_below_the_floor_has_arrived() -> None:
    assert theory.impact_time_free(fall(), 2.0) == 0
    assert theory.impact_time_damped(fall(), 2.0) == 0


@pytest.mark.parametrize(("v0", "time_s"), [(0.0, 0.0), (-2.0, 0.0), (2.0, 2 * 2.0 / 9.81)])
def test_a_body_on_the_floor_has_arrived_unless_it_is_thrown_up(v0: float, time_s: float) -> None:
    on_it = fall(k=0.0, v=v0)
    for impact_time in (theory.impact_time_free, theory.impact_time_damped):
        assert impact_time(on_it, on_it.height_m) == pytest.approx(time_s, rel=1e-15)

"""Verification of the refinement studies: orders, limits and indices of series that are known."""

from __future__ import annotations

import math

import pytest
from scipy.special import stdtrit

from pipeline.budget.convergence import (
    Run,
    cancelling_timestep,
    grid_convergence_index,
    observed_orders,
    richardson,
    solution_order,
    study_of,
)
from pipeline.budget.statistics import MANY, Moments, students_t

HALVED = [1 / 240, 1 / 480, 1 / 960]


def test_the_observed_order_of_a_power_law_is_its_exponent() -> None:
    errors = [0.7 * h**1.5 for h in HALVED]
    assert observed_orders(HALVED, errors) == pytest.approx([1.5, 1.5], abs=1e-12)
    assert observed_orders(HALVED, [-e for e in errors]) == observed_orders(HALVED, errors)
    assert observed_orders([0.2, 0.1], [0.0, 1.0]) == [None]


@pytest.mark.parametrize("steps", [HALVED, [0.1, 0.05, 0.01], [0.4, 0.3, 0.1]])
@pytest.mark.parametrize("order", [1.0, 2.0, 0.5])
def test_three_solutions_give_order_and_limit(steps: list[float], order: float) -> None:
    """Of f = 2 - 3 h^p, with one ratio and with two."""
    solutions = [2 - 3 * h**order for h in steps]
    found = solution_order(steps, solutions)
    assert found == pytest.approx(order, abs=1e-9)
    limit = richardson(*solutions[1:], ratio=steps[1] / steps[2], order=order)
    assert limit == pytest.approx(2.0, abs=1e-12)


def test_what_does_not_close_in_has_no_order() -> None:
    assert solution_order(HALVED, [1.0, 2.0, 1.5]) is None  # from both sides
    assert solution_order(HALVED, [1.0, 2.0, 2.0]) is None
    assert solution_order(HALVED, [0.0, 1.0, 3.0]) is None  # apart


def test_the_convergence_index_is_an_estimate_times_the_safety_factor() -> None:
    """For f = 2 - 3 h the estimate without it is the error itself, |f - 2| / |f|."""
    coarse, fine = 2 - 3 * 0.2, 2 - 3 * 0.1
    index = grid_convergence_index(coarse, fine, ratio=2, order=1)
    assert index == pytest.approx(1.25 * 0.3 / fine, rel=1e-12)


def test_errors_of_opposite_signs_cancel_at_a_timestep() -> None:
    """At dt* = 2 damping/(g t) where -g t dt/2 + damping = 0: the article's drop at 0.3 s."""
    damping_m = 0.0043102198351
    found = cancelling_timestep(1 / 240, timestep_m=-9.81 * 0.3 / 480, damping_m=damping_m)
    assert found == pytest.approx(2 * damping_m / (9.81 * 0.3), rel=1e-14)
    assert found is not None
    assert round(1 / found) == 341
    assert cancelling_timestep(1 / 240, timestep_m=-1.0, damping_m=0.0) is None
    assert cancelling_timestep(1 / 240, timestep_m=-1.0, damping_m=-1.0) is None


def test_a_study_of_the_articles_golden_heights() -> None:
    """Golden values of PyBullet 3.2.7 at 0.3 s, default damping; see tests/test_golden.py."""
    golden = {240: 0.5567296523863766, 480: 0.5597951433403751, 960: 0.5613277333771846}
    damping_m, free_fall_m = 0.0043102198351314455, 1 - 9.81 * 0.3**2 / 2
    runs = []
    for frequency, height_m in golden.items():
        timestep_m = -9.81 * 0.3 / frequency / 2
        error_m = height_m - free_fall_m
        runs.append(
            Run(1 / frequency, height_m, error_m, timestep_m, damping_m,
                error_m - timestep_m - damping_m, 0.0)
        )  # fmt: skip
    study = study_of(runs[::-1])
    assert [run.timestep_s for run in study.runs] == HALVED
    assert study.orders_free_fall == pytest.approx([0.5479, -1.1576], abs=1e-4)
    assert study.orders_damped_fall == pytest.approx([1.0, 1.0], abs=1e-4)
    assert study.order == pytest.approx(1.000146, abs=1e-6)
    assert study.damped_fall_m == pytest.approx(free_fall_m + damping_m, abs=1e-15)
    assert study.extrapolated_m == pytest.approx(study.damped_fall_m, abs=3e-7)
    assert study.grid_convergence_index == pytest.approx(0.003412, abs=1e-6)
    assert study.relative_error == pytest.approx(0.002730, abs=1e-6)
    assert study.refining_hurts
    assert not study_of(runs[:2]).refining_hurts
    assert study_of(runs[:2]).order is None


def test_moments_are_those_of_all_values_however_they_came() -> None:
    values = [1e9 + x for x in (1.0, 2.0, 4.0, 8.0, 16.0)]
    in_parts = Moments().with_values(values[:2]).merged(Moments().with_values(values[2:]))
    assert in_parts.count == 5
    assert in_parts.mean == pytest.approx(1e9 + 6.2, rel=1e-15)
    assert in_parts.spread == pytest.approx(math.sqrt(37.2), rel=1e-6)  # 1e9 takes nine digits
    assert Moments().with_values([1.0]).interval is None


@pytest.mark.parametrize("value", [-6.131250000000108e-3, 0.1, 1 / 3, 1e9 + 0.1])
def test_equal_values_have_no_spread_at_all(value: float) -> None:
    """A mean of equal values, summed up and divided, may be off by its last bit, and they by it."""
    moments = Moments().with_values([value] * 300)
    assert (moments.mean, moments.spread, moments.interval) == (value, 0.0, (value, value))
    assert moments.merged(moments).with_values([value] * 7) == Moments(607, value, 0.0)


def test_the_interval_is_students() -> None:
    """Five values of spread 1: half width t(4, 97.5 %) / sqrt 5, with t = 2.776445105 of tables."""
    values = [x / math.sqrt(2.5) for x in (-2.0, -1.0, 0.0, 1.0, 2.0)]
    low, high = Moments().with_values(values).interval or (0.0, 0.0)
    assert (low, high) == pytest.approx((-1.241664, 1.241664), abs=1e-6)


@pytest.mark.parametrize("count", [2, 30, MANY + 5])
def test_the_interval_encloses_the_mean_from_both_sides(count: int) -> None:
    """95 % inside, 2.5 % on either side; of many values it is the normal's, ± 1.96 s/√n."""
    moments = Moments().with_values([float(number % 2) for number in range(count)])
    low, high = moments.interval or (math.nan, math.nan)
    half = stdtrit(count - 1, 0.975) * (moments.spread or 0.0) / math.sqrt(count)
    assert (low, high) == pytest.approx((moments.mean - half, moments.mean + half), rel=1e-11)
    assert count < MANY or half == pytest.approx(1.96 * 0.5 / math.sqrt(count), rel=2e-3)


def test_students_quantile_has_no_step_where_it_changes_its_source() -> None:
    for degrees in (MANY - 1, MANY, 10 * MANY):
        assert students_t(degrees) == pytest.approx(stdtrit(degrees, 0.975), rel=1e-11)

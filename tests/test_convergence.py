"""Verification of the refinement studies: orders, limits and indices of known series."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from drop_physics.drop.convergence import (
    StudiedRun,
    cancelling_timestep,
    grid_convergence_index,
    observed_orders,
    richardson,
    solution_order,
    study_of,
)
from drop_physics.drop.statistics import Moments, summaries
from scipy.special import stdtrit

HALVED = [1 / 240, 1 / 480, 1 / 960]


def test_the_observed_order_of_a_power_law_is_its_exponent() -> None:
    errors = [0.7 * h**1.5 for h in HALVED]
    assert observed_orders(HALVED, errors) == pytest.approx([1.5, 1.5], abs=1e-12)
    assert observed_orders(HALVED, [-e for e in errors]) == observed_orders(HALVED, errors)
    assert observed_orders([0.2, 0.1], [0.0, 1.0]) == [None]


@pytest.mark.parametrize("steps", [HALVED, [0.1, 0.05, 0.01], [0.4, 0.3, 0.1]])
@pytest.mark.parametrize("order", [1.0, 2.0, 0.5])
def test_three_solutions_give_order_and_limit(steps: list[float], order: float) -> None:
    """For f = 2 - 3 h^p, with equal ratios and with different ones."""
    solutions = [2 - 3 * h**order for h in steps]
    observed = solution_order(steps, solutions)
    assert observed == pytest.approx(order, abs=1e-9)
    limit = richardson(*solutions[1:], ratio=steps[1] / steps[2], order=order)
    assert limit == pytest.approx(2.0, abs=1e-12)


def test_a_series_that_does_not_converge_has_no_order() -> None:
    assert solution_order(HALVED, [1.0, 2.0, 1.5]) is None  # oscillating
    assert solution_order(HALVED, [1.0, 2.0, 2.0]) is None
    assert solution_order(HALVED, [0.0, 1.0, 3.0]) is None  # diverging
    assert solution_order([1 / 10, 1 / 20, 1 / 30], [3.0, 2.0, 1.0]) is None  # with two ratios


def test_the_convergence_index_is_an_estimate_times_the_safety_factor() -> None:
    """For f = 2 - 3 h the estimate without it is the error itself, |f - 2| / |f|."""
    coarse, fine = 2 - 3 * 0.2, 2 - 3 * 0.1
    index = grid_convergence_index(coarse, fine, ratio=2, order=1)
    assert index == pytest.approx(1.25 * 0.3 / fine, rel=1e-12)


def test_errors_of_opposite_signs_cancel_at_a_timestep() -> None:
    """At dt* = 2 damping/(g t) where -g t dt/2 + damping = 0: the article's drop at 0.3 s."""
    damping_m = 0.0043102198351
    timestep_s = cancelling_timestep(
        1 / 240, timestep_m=-9.81 * 0.3 / 480, damping_m=damping_m, interaction_m=0.009 * damping_m
    )
    assert timestep_s == pytest.approx(2 * damping_m / (9.81 * 0.3), rel=1e-14)
    assert timestep_s is not None
    assert round(1 / timestep_s) == 341
    assert cancelling_timestep(1 / 240, timestep_m=-1.0, damping_m=0.0, interaction_m=0.0) is None
    assert cancelling_timestep(1 / 240, timestep_m=-1.0, damping_m=-1.0, interaction_m=0.0) is None
    assert cancelling_timestep(1 / 240, timestep_m=-1.0, damping_m=1.0, interaction_m=0.02) is None


def test_a_study_of_the_articles_golden_heights() -> None:
    """Golden values of PyBullet 3.2.7 at 0.3 s, default damping; see tests/test_golden.py."""
    golden = {240: 0.5567296523863766, 480: 0.5597951433403751, 960: 0.5613277333771846}
    damping_m, free_fall_m = 0.0043102198351314455, 1 - 9.81 * 0.3**2 / 2
    runs = []
    for frequency, height_m in golden.items():
        timestep_m = -9.81 * 0.3 / frequency / 2
        error_m = height_m - free_fall_m
        runs.append(
            StudiedRun(
                1 / frequency,
                height_m,
                error_m,
                timestep_m,
                damping_m,
                error_m - timestep_m - damping_m,
                0.0,
            )
        )
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


def runs_of(error_of: Callable[[float], float], frequencies: Sequence[int]) -> list[StudiedRun]:
    """Return runs towards 0.5 m that differ from it by an error, all of it the timestep's."""
    errors = [error_of(1 / frequency) for frequency in frequencies]
    return [
        StudiedRun(1 / frequency, 0.5 + error, error, error, 0.0, 0.0, 0.0)
        for frequency, error in zip(frequencies, errors, strict=True)
    ]


@pytest.mark.parametrize(("share", "known"), [(0.005, True), (0.02, False), (1.0, False)])
def test_rounding_has_no_order(share: float, known: bool) -> None:
    """Without an error of the method, rounding is all there is: it has no order."""
    runs = runs_of(lambda h: 1e-3 * h, (240, 480, 960))
    smallest_m = min(abs(run.error_m) for run in runs)
    rounded = [
        replace(run, timestep_m=run.error_m - share * smallest_m, rounding_m=share * smallest_m)
        for run in runs
    ]
    study = study_of(rounded)
    assert (study.orders_free_fall[-1] is not None) == known
    assert (study.orders_damped_fall[-1] is not None) == known
    assert (study.order is not None) == known
    assert (study.extrapolated_m is not None) == known


def test_order_and_limit_are_those_of_the_finest_runs() -> None:
    """The coarsest of four is not in the asymptotic range, and the finest have two ratios."""
    study = study_of(runs_of(lambda h: 3 * h if h < 0.1 else 1.0, (5, 20, 40, 120)))
    assert study.order == pytest.approx(1.0, abs=1e-9)
    assert study.extrapolated_m == pytest.approx(0.5, abs=1e-12)
    finest_m = 0.5 + 3 / 120
    assert study.relative_error == pytest.approx(3 / 120 / finest_m, rel=1e-12)
    assert study.grid_convergence_index == pytest.approx(1.25 * study.relative_error, rel=1e-9)
    assert study.damped_fall_m == 0.5


def test_the_damping_of_a_study_is_that_of_the_finest_runs() -> None:
    """Its limit is the damping's share; where that cancels follows from the timestep's share, too.

    The coarsest run has other shares, as it would at another time.
    """
    coarse = StudiedRun(0.1, 0.4, -0.1, -0.3, 0.2, 0.0, 0.0)
    fine = StudiedRun(0.02, 0.5 + 1e-3, 1e-3, -0.004, 0.005, 2e-5, -3e-4)
    study = study_of([coarse, fine])
    assert study.limit_m == 0.005
    assert study.cancelling_timestep_s == pytest.approx(0.02 * 0.005 / 0.004)
    assert fine.discretisation_m == pytest.approx(-0.004 + 2e-5 - 3e-4)
    assert study.damped_fall_m == pytest.approx(fine.simulated_m - fine.discretisation_m)
    assert study.relative_error == pytest.approx(0.00428 / 0.501)


@pytest.mark.parametrize(
    ("damping_m", "matters"),
    [(1e-12, False), (-1e-12, False), (0.99e-7, False), (1.01e-7, True), (4e-3, True)],
)
def test_damping_matters_where_it_shows_in_an_order(damping_m: float, matters: bool) -> None:
    """In errors of 2 mm and 1 mm: an order of 1 is then off by at most 1e-4."""
    runs = [
        StudiedRun(step_s, 0.5, error_m, error_m - damping_m, damping_m, 0.0, 0.0)
        for step_s, error_m in ((1 / 240, 2e-3), (1 / 480, 1e-3))
    ]
    study = study_of(runs)
    assert study.damping_matters == matters
    without = observed_orders(HALVED[:2], [run.timestep_m for run in runs])[0] or 0.0
    assert matters or abs(without - 1) < 1e-4


@pytest.mark.parametrize(
    ("cancelling_s", "near"),
    [
        (1 / 13487086115049, False),
        (1 / 9610, False),
        (1 / 9590, True),
        (1 / 341, True),
        (1 / 25, True),
        (1 / 23, False),
        (None, False),
    ],
)
def test_errors_that_cancel_far_from_all_timesteps_are_not_reported(
    cancelling_s: float | None, near: bool
) -> None:
    """For 1/240 to 1/960 s, 1/9600 to 1/24 s are near; a step longer than the fall is not."""
    plain = study_of(runs_of(lambda step_s: step_s, (240, 480, 960)))
    study = replace(plain, cancelling_timestep_s=cancelling_s)
    assert study.cancels_near(0.3) == near
    assert not study.cancels_near(1e-5)


def test_a_height_of_zero_has_no_relative_error() -> None:
    runs = [
        StudiedRun(step_s, -step_s * n, step_s, step_s, 0.0, 0.0, 0.0)
        for step_s, n in ((1 / 240, 2), (1 / 480, 1), (1 / 960, 0))
    ]
    study = study_of(runs)
    assert study.order is not None
    assert (study.relative_error, study.grid_convergence_index) == (None, None)


@pytest.mark.parametrize(
    ("errors", "hurts"),
    [
        ((3.0, 2.0, 1.0), False),
        ((-3.0, -2.0, -1.0), False),
        ((2.0, 2.0), False),
        ((-1.0, 2.0), True),
        ((1.0, -2.0), True),
        ((3.0, 1.0, 2.0), True),
        ((3.0, 1.0, 1.005), False),
    ],
)
def test_refining_hurts_where_the_size_of_the_error_grows(
    errors: tuple[float, ...], hurts: bool
) -> None:
    of_step = {1 / (10 * number): error for number, error in enumerate(errors, start=1)}
    runs = runs_of(of_step.__getitem__, [10 * number for number in range(1, len(errors) + 1)])
    assert study_of(runs).refining_hurts == hurts


def test_a_summary_leaves_out_the_rows_that_have_no_number() -> None:
    """For 0 … 100, shuffled, with gaps left out: quantiles 5, 50 and 95, mean 50, spread 29.3."""
    values = np.random.default_rng(1).permutation(101).astype(float).tolist()
    rows = pl.LazyFrame(
        {"error_m": [*values, None, None], "damping_m": [None] * 103},
        schema_overrides={"damping_m": pl.Float64},
    )
    (summary,) = summaries(rows, ("error_m", "damping_m"))
    assert (summary.quantity, summary.count, summary.mean) == ("error_m", 101, pytest.approx(50))
    assert summary.quantiles == pytest.approx({"5%": 5, "50%": 50, "95%": 95})
    assert summary.spread == pytest.approx(math.sqrt(101 * 102 / 12))
    half = 1.983971519 * math.sqrt(102 / 12)  # t(100, 97.5 %) of tables
    assert summary.interval == pytest.approx((50 - half, 50 + half), rel=1e-8)


def test_moments_of_parts_merge_to_those_of_all_values() -> None:
    values = [1e9 + x for x in (1.0, 2.0, 4.0, 8.0, 16.0)]
    in_parts = Moments().with_values(values[:2]).merged(Moments().with_values(values[2:]))
    assert in_parts.count == 5
    assert in_parts.mean == pytest.approx(1e9 + 6.2, rel=1e-15)
    assert in_parts.spread == pytest.approx(math.sqrt(37.2), rel=1e-6)  # 1e9 takes nine digits
    assert Moments().with_values([1.0]).interval is None


@pytest.mark.parametrize("value", [-6.131250000000108e-3, 0.1, 1 / 3, 1e9 + 0.1])
def test_equal_values_have_no_spread_at_all(value: float) -> None:
    """A computed mean of equal values may be off by its last bit, and so would be their spread."""
    moments = Moments().with_values([value] * 300)
    assert (moments.mean, moments.spread, moments.interval) == (value, 0.0, (value, value))
    assert moments.merged(moments).with_values([value] * 7) == Moments(607, value, 0.0)


def test_the_interval_is_students() -> None:
    """Five values of spread 1: half width t(4, 97.5 %) / sqrt 5, with t = 2.776445105 of tables."""
    values = [x / math.sqrt(2.5) for x in (-2.0, -1.0, 0.0, 1.0, 2.0)]
    low, high = Moments().with_values(values).interval or (0.0, 0.0)
    assert (low, high) == pytest.approx((-1.241664, 1.241664), abs=1e-6)


@pytest.mark.parametrize("count", [2, 30, 1005])
def test_the_interval_encloses_the_mean_from_both_sides(count: int) -> None:
    """95 % inside, 2.5 % on either side; of many values it is the normal's, ± 1.96 s/√n."""
    moments = Moments().with_values([float(number % 2) for number in range(count)])
    low, high = moments.interval or (math.nan, math.nan)
    half = stdtrit(count - 1, 0.975) * (moments.spread or 0.0) / math.sqrt(count)
    assert (low, high) == pytest.approx((moments.mean - half, moments.mean + half), rel=1e-11)
    assert count < 1000 or half == pytest.approx(1.96 * 0.5 / math.sqrt(count), rel=2e-3)

"""Verification of Richardson extrapolation: order and limit of known series."""

from __future__ import annotations

import pytest
from drop_physics.experiments.refinement import richardson, solution_order

HALVED = [1 / 240, 1 / 480, 1 / 960]


@pytest.mark.parametrize("steps", [HALVED, [0.1, 0.05, 0.01], [0.4, 0.3, 0.1]])
@pytest.mark.parametrize("order", [1.0, 2.0, 0.5])
def test_three_solutions_give_order_and_limit(steps: list[float], order: float) -> None:
    """The series is f = 2 - 3 h^p, with equal and with different refinement ratios."""
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

"""Expectations: the meaning of an expression, and the margin by which it holds.

Verification: the margin is the distance to the nearest value with which the expression would be
true, which is worked out by hand beside each case.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drop_physics.engines.watching.expected import ExpectationEvaluator
from drop_physics.engines.watching.expression import Expression
from drop_physics.engines.watching.observed import Observed, UnknownNameError, found
from drop_physics.engines.watching.series import FUNCTIONS, series_of

TIMES_S = [0.1, 0.2, 0.3, 0.4]
HEIGHT = series_of([0.5, 0.9, -0.7, 0.2], TIMES_S)
FORCE = series_of([[3.0, 4.0], [0.0, 1.0], [6.0, 8.0], [0.0, 2.0]], TIMES_S)
OURS: dict[str, Any] = {**FUNCTIONS, "z": lambda _: HEIGHT, "sensor": lambda _: FORCE}
OURS |= {"terminated": True, "length": 50, "reward": 7.0}


@pytest.mark.parametrize(
    ("text", "holds", "margin", "value"),
    [
        ("z('cube') > 0.3", False, -0.1, 0.2),  # a bare series is its end
        ("0.3 < z('cube')", False, -0.1, 0.2),
        ("end(z('cube')) >= 0.2", True, 0.0, 0.2),
        ("peak(z('cube')) < 1", True, 0.1, 0.9),
        ("low(z('cube')) > 0", False, -0.7, -0.7),
        ("drift(z('cube')) < 0.2", False, -0.1, 0.3),
        ("at(z('cube'), 0.2) > 1", False, -0.1, 0.9),
        ("z('cube').at(0.25) > 0", False, -0.7, -0.7),
        ("always(z('cube') > 0)", False, -0.7, -0.7),
        ("ever(z('cube') > 0.8)", True, 0.1, 0.9),
        ("norm(sensor('touch')) > 3", False, -1.0, 2.0),
        ("peak(norm(sensor('touch'))) > 3", True, 7.0, 10.0),
        ("0.1 < z('cube') < 0.5", True, 0.1, 0.2),
        ("not terminated", False, -1 / 50, 1.0),  # an end after twice the steps is half as far
        ("z('cube') > 0.1 and z('cube') > 0.4", False, -0.2, 0.2),
        ("z('cube') > 0.1 or z('cube') > 0.4", True, 0.1, 0.2),
        ("not z('cube') > 0.4", True, 0.2, 0.2),
        ("abs(z('cube') - 1) < 0.5", False, -0.3, 0.8),
        ("count == 3", False, -1.0, 2.0),
        ("fell", False, -1.0, 0.0),
    ],
)
def test_an_expression_holds_by_a_margin(
    text: str, holds: bool, margin: float, value: float
) -> None:
    judged = Expression(text).judged({"count": 2, "fell": False}, OURS)
    assert judged[0] == holds
    assert judged[1:] == pytest.approx((margin, value))


def test_a_number_of_the_script_covers_no_function_of_ours_and_a_function_does() -> None:
    """A script's number named `end` does not hide our function `end`; a script's function does."""
    script = {"end": 0.75, "z": 3.0}
    assert Expression("end > 0.7 and end(z('cube')) < 0.3").judged(script, OURS)[0]
    own = {"low": lambda _: 5.0}
    assert Expression("low(z('cube')) == 5").judged(own, OURS)[0]


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("z('cube') > 0.3", "m"),
        ("abs(end(x('a')) - end(x('b'))) < 0.1", "m"),
        ("peak(force('a')) < 5", "N"),
        ("z('a') * 2 > 1", None),
        ("z('a') > 1 and force('a') > 1", None),
        ("z('a') > height", None),
        ("joint('knee') > 1", None),
        ("height > 1", None),
    ],
)
def test_the_unit_of_series_is_known(text: str, unit: str | None) -> None:
    assert Expression(text).unit == unit


def test_what_is_read_is_known_before_a_run() -> None:
    reads = [*Expression("peak(z('cube')) > force('a', 'b') + x(name)").reads()]
    assert sorted(reads, key=str) == [("force", ("a", "b")), ("x", None), ("z", ("cube",))]
    with pytest.raises(SyntaxError):
        Expression("z('cube' > 0.3")


class Falling(Observed):
    """A body whose height falls with its number of steps."""

    def __init__(self) -> None:
        self.steps = 0

    @property
    def time_s(self) -> float:
        """Return the time: a tenth of a second per step."""
        return 0.1 * self.steps

    def reader(self, _: str, *names: Any) -> Any:
        """Return a function that reads a height that decreases by one per step."""
        if names != ("ball",):
            raise UnknownNameError(names[0], ["ball", "wall", "floor"])
        return lambda: -float(self.steps)

    def positions(self) -> list[float]:
        """Return the body's position."""
        return 3 * [0.0, 0.0, -float(self.steps)]

    def bodies(self) -> list[str]:
        """Return the body's name."""
        return ["ball"]

    def astray(self) -> dict[str, float]:
        """Return the body's distance from its target: none."""
        return {}

    def is_finite(self) -> bool:
        """Return True: the state is finite."""
        return True


def run_of(text: str, steps: int = 3) -> Any:
    """Return the result of an expectation in a run whose steps a function of the script makes."""
    expected, falling = ExpectationEvaluator(text), Falling()
    host = SimpleNamespace(environments=SimpleNamespace(outcome=lambda _: {}))
    engine: Any = SimpleNamespace(observed=lambda: falling, host=host)

    def step() -> None:
        height = -float(falling.steps)  # a local name of the function that makes the last step
        assert height <= 0
        falling.steps += 1
        import sys

        expected.step(engine, sys._getframe())

    def main() -> None:
        measured = []
        for _ in range(steps):
            step()
            measured.append(falling.steps)

    main()
    return expected.answer()


def test_names_are_those_of_the_frames_that_made_the_last_step_as_they_are_at_the_end() -> None:
    assert run_of("measured == [1, 2, 3]")["holds"]
    assert run_of("height == -2 and z('ball') == -3")["holds"]
    assert run_of("TIMES_S[0] == 0.1")["holds"], "the module's"


def test_an_unknown_name_is_told_with_the_nearest() -> None:
    error = run_of("mesured > 2")["error"]
    assert (error["unknown"], error["nearest"][0]) == ("mesured", "measured")
    error = run_of("z('bal') > 2")["error"]
    assert (error["unknown"], error["nearest"][0]) == ("bal", "ball")
    assert len(error["nearest"]) <= 5


def test_a_label_names_a_body_by_its_id_or_by_a_name_that_no_other_has() -> None:
    known = {"ball": 1, "1_ball": 1, "2_ball": 2, "box": 3, "3_box": 3}
    assert [found(each, known) for each in ("2_ball", "ball", "7_box")] == [2, 1, 3]
    for name in ("7_ball", "1_cone", "_box"):
        with pytest.raises(UnknownNameError):
            found(name, known)


def test_how_everything_moved_is_kept_at_few_of_many_steps() -> None:
    from drop_physics.experiments.motion import motion_of

    (motion,) = run_of("True", steps=1000)["motion"]
    kept = motion_of(motion)
    assert kept.steps == 1000
    assert len(kept.positions_m) <= 161
    heights = kept.positions_m[:, 0, 2]
    np.testing.assert_array_equal(heights, -1.0 - kept.stride * np.arange(len(heights)))

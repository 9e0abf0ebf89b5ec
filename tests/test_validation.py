"""docs/validation.md: exact results about bodies, and PyBullet's values."""

from __future__ import annotations

from itertools import pairwise

import pytest
from generators import validation
from generators.pages import DOCS
from generators.validation import Figure

pytestmark = pytest.mark.long

AGAIN = "the page is stale; make it again with: python docs/regenerate.py validation.md"


@pytest.fixture(scope="module")
def figures() -> list[Figure]:
    return validation.figures()


def test_every_figure_is_as_near_to_its_formula_as_the_page_says(figures: list[Figure]) -> None:
    assert len(figures) == 15
    for one in figures:
        assert abs(one.measured - one.theory) <= one.within, one.what


def test_what_the_timestep_makes_of_a_way_is_what_is_said_of_it(figures: list[Figure]) -> None:
    slides, rises, falls, _, rolls, *_ = figures
    assert slides.measured - slides.theory == pytest.approx(-2 / 240 / 2, rel=0.01)
    assert rises.measured - rises.theory == pytest.approx(-6 / 240 / 2, rel=0.01)
    assert falls.measured - falls.theory == pytest.approx(-9.81 * 0.5 / 480, rel=1e-9)
    assert rolls.measured / rolls.theory - 1 == pytest.approx(1 / 480, rel=0.01)


def test_half_the_timestep_halves_the_drift_of_a_body_that_tumbles(figures: list[Figure]) -> None:
    drifts = [one.measured for one in figures if "tumbles" in one.what]
    assert len(drifts) == 8
    for coarse, fine in ((drifts[n], drifts[n + 2]) for n in (0, 1, 4, 5)):
        assert coarse / fine == pytest.approx(2, rel=0.05)
    assert all(one != other for one, other in pairwise(drifts))


def test_the_page_is_that_of_the_recordings(figures: list[Figure]) -> None:
    (text,) = validation.made(figures).values()
    assert (DOCS / "validation.md").read_text(encoding="utf-8") == text, AGAIN

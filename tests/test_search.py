"""The search for a change that meets an expectation: what is tried, reported, in which order.

Verification: the runs are a function of what is changed, so it is known what makes it true.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from drop_physics.engines.source import PlacedText, changes_of, converts_unit
from drop_physics.engines.watching.single_changes import Change, how_of
from drop_physics.experiments.motion import RunMotion, apart_m, fastest, side_m, thrown
from drop_physics.experiments.ranking import ranked
from drop_physics.experiments.search import ChangeOutcome, Search

FRICTION = Change("geom_friction", "*10", ("*", 10.0), tuple(range(12)), tuple("abcdefghijkl"))
GRAVITY = Change("flag.GRAVITY", "^", ("^", None), breaks=True)
TIMESTEP = Change("option.timestep", "/2", ("/", 2.0))


def motion(height_m: float, aside_m: float = 0.0) -> RunMotion:
    """Return the motion of a cube that stays at a height, and of a table beside it."""
    positions = np.zeros((5, 2, 9))
    positions[:, 0, 2::3], positions[:, 1, ::3] = height_m, aside_m
    return RunMotion(1, 5, ("cube", "table"), {}, positions, 0.01)


@dataclass
class Runs:
    """Simulated runs whose outcome is a given function of the change."""

    height_m: Callable[[Change], float]
    aside_m: Callable[[Change], float] = lambda _: 0.0
    most: int = 1000

    def __post_init__(self) -> None:
        self.made: list[Change] = []

    def __call__(self, changes: Iterator[Change]) -> Iterable[tuple[Change, ChangeOutcome | None]]:
        """Run changes, one after another."""
        for change in changes:
            if len(self.made) >= self.most:
                yield change, None
                continue
            self.made.append(change)
            height = self.height_m(change)
            moved = motion(height, self.aside_m(change))
            yield change, ChangeOutcome(height > 0.3, height - 0.3, height, [moved])


def searched(runs: Runs, *changes: Change) -> Search:
    """Return a search for changes that lift a cube from 0.1 m above the expected 0.3 m."""
    search = Search(ChangeOutcome(False, -0.2, 0.1, [motion(0.1)]), runs)
    search.all_of(changes)
    return search


def test_a_kind_is_tried_at_once_and_the_element_that_does_it_is_said() -> None:
    runs = Runs(lambda change: 0.5 if 7 in change.ids else 0.1)
    search = searched(runs, FRICTION, TIMESTEP)
    assert [*map(len, (each.ids for each in runs.made))] == [12, 6, 6, 1, 1, 1, 1, 1, 1, 0]
    (said,) = ranked(search.tried)
    assert said.tried.change.of == ("h",)


def test_elements_of_what_only_moves_it_are_tried_after_all_kinds() -> None:
    """Of two elements, one lifts the cube, and the other holds it down."""
    two = FRICTION.of_some([0, 1])
    runs = Runs(lambda change: {(0, 1): 0.2, (0,): 0.5}.get(change.ids, 0.1))
    search = searched(runs, two, TIMESTEP)
    assert [each.ids for each in runs.made] == [(0, 1), (), (0,), (1,)]
    assert [each.tried.change.of for each in ranked(search.tried)] == [("a",)]


def test_what_takes_nothing_away_comes_first_then_what_moves_least_besides() -> None:
    aside = {"geom_friction": 0.2, "option.timestep": 0.1, "flag.GRAVITY": 0.0}
    runs = Runs(lambda change: 0.5 + aside[change.change], lambda change: aside[change.change])
    search = searched(runs, GRAVITY, FRICTION.of_some([0]), TIMESTEP)
    said = ranked(search.tried, besides=["cube"])
    assert [each.tried.change.change for each in said] == [
        "option.timestep",
        "geom_friction",
        "flag.GRAVITY",
    ]
    assert [each.side_m for each in said] == pytest.approx([0.1, 0.2, 0.0])


def test_changes_with_the_same_motion_are_one_outcome_said_by_what_takes_nothing_away() -> None:
    search = searched(Runs(lambda _: 0.5), GRAVITY, TIMESTEP)
    (said,) = ranked(search.tried)
    assert said.tried.change == TIMESTEP
    assert [each.change for each in said.alike] == [GRAVITY]


def test_of_changes_with_the_same_motion_the_one_of_a_named_element_is_said() -> None:
    solver = Change("setPhysicsEngineParameter.numSubSteps", "=10", ("=", 10.0), ((0,),))
    force = Change("changeConstraint.maxForce", "=50", ("=", 50.0), ((0, 1),), ("constraint1",))
    (said,) = ranked(searched(Runs(lambda _: 0.5), solver, force).tried)
    assert said.tried.change == force


def test_an_element_that_one_line_sets_is_tried_as_that_line_and_once() -> None:
    lines = [("a.py", 3), ("a.py", 4)]
    alone = [replace(FRICTION.of_some([n]), site=line) for n, line in enumerate(lines)]
    together = replace(FRICTION.of_some([0, 1]), sites=tuple(lines))
    runs = Runs(lambda change: 0.5 if 1 in change.ids else 0.1)
    said = ranked(searched(runs, *alone, together).tried)
    assert runs.made == [alone[0], alone[1], together]
    assert [each.tried.change for each in said] == [alone[1]]


def test_a_number_on_the_other_side_of_the_expected_one_is_off_by_both() -> None:
    five, one = ChangeOutcome(False, -2.0, 5.0), ChangeOutcome(False, -2.0, 1.0)
    assert five.off(one) == 4.0
    assert five.is_across(one), "three is expected"
    worst, worse = ChangeOutcome(False, -19_688.0, 20_688.0), ChangeOutcome(False, -71e3, 72e3)
    assert not worst.is_across(worse), "both are above 1,000"
    assert not five.is_across(five)
    assert five.off(ChangeOutcome(False, -np.inf, np.nan)) == 0.0


def test_a_second_list_is_tried_without_what_was_tried_before() -> None:
    runs = Runs(lambda change: 0.2 if change.ids else 0.1)
    search = searched(runs, FRICTION.of_some([0, 1]))
    before = [*runs.made]
    search.all_of([TIMESTEP])
    assert runs.made == [*before, TIMESTEP]


SPEED = Change(
    "SPEED",
    "*0.1",
    ("*", 0.1),
    (PlacedText("", 40, 41, "5", "", "lift.py:7", is_count=False, paces=False),),
    ("5",),
    site=("lift.py", 7),
    engine="source",
)


def test_another_text_with_which_everything_moves_as_before_is_not_said() -> None:
    """A change that affects only how the quantity is measured is not reported."""
    still = ChangeOutcome(True, 0.2, 0.5, [motion(0.1)])
    search = Search(
        ChangeOutcome(False, -0.2, 0.1, [motion(0.1)]),
        lambda all_: ((each, still) for each in all_),
    )
    search.all_of([SPEED, TIMESTEP])
    assert [each.tried.change for each in ranked(search.tried)] == [TIMESTEP]


def test_another_text_that_throws_things_out_of_the_scene_takes_it_apart() -> None:
    """A change that throws bodies far beyond the scene (0.1 m high) counts as destructive."""
    for aside_m, breaks in ((0.4, False), (0.6, True)):
        search = searched(Runs(lambda _: 0.5, lambda _, by=aside_m: by), SPEED, TIMESTEP)
        said = {each.tried.change.change: each.tried.change.breaks for each in ranked(search.tried)}
        assert said == {"option.timestep": False}, "with one motion, the model is said"
        (tried,) = (each for each in search.tried if each.change.change == "SPEED")
        assert tried.change.breaks == breaks


def test_a_timestep_with_which_the_run_simulates_another_time_does_not_count() -> None:
    """The run makes five steps of 0.01 s; with a tenth of the step it simulates as long, or not."""
    for steps, own_s, holds in (
        (50, 0.01, True),
        (5, 0.01, False),
        (500, 0.01, False),
        (5, 0, True),
    ):
        moved = replace(motion(0.5), steps=steps, step_s=0.001)
        runs = Runs(lambda _: 0.5)
        search = Search(
            ChangeOutcome(False, -0.2, 0.1, [replace(motion(0.1), step_s=own_s)]),
            lambda all_, moved=moved: (
                (each, ChangeOutcome(True, 0.2, 0.5, [moved])) for each in all_
            ),
        )
        (text,) = SPEED.ids
        paced = replace(SPEED, change="option.timestep", ids=(text._replace(paces=True),))
        search.all_of([paced])
        assert search.tried[0].outcome.holds == holds
        assert not runs.made


def test_a_body_is_thrown_if_it_is_much_faster_than_all_that_moved_before() -> None:
    """A cube rises by 0.1 m within 0.01 s in the script's own run, and by 0.15 or 0.25 m."""

    def rising(by_m: float) -> RunMotion:
        moved = motion(0.1)
        moved.positions_m[3:, 0, 2::3] += by_m
        return moved

    assert fastest([rising(0.1)]) == ("cube", pytest.approx(10.0))
    assert thrown([rising(0.1)], [rising(0.15)]) is None
    assert thrown([rising(0.1)], [rising(0.25)]) == ("cube", pytest.approx(25.0))
    assert thrown([motion(0.1)], [rising(0.009)]) is None, "0.9 m/s is no throw"


def test_another_text_has_to_do_it_with_less_than_half_of_the_side_effects() -> None:
    for aside_m, first in ((0.06, "option.timestep"), (0.04, "SPEED")):
        aside = {"SPEED": aside_m, "option.timestep": 0.1}
        runs = Runs(
            lambda each: 0.35 + 0.01 * len(each.ids), lambda each, by=aside: by[each.change]
        )
        said = ranked(searched(runs, SPEED, TIMESTEP).tried, besides=["cube"])
        assert said[0].tried.change.change == first


def test_a_row_of_the_account_goes_with_what_acts_on_its_term() -> None:
    search = searched(
        Runs(lambda change: 0.5 + 0.1 * len(change.ids)), FRICTION.of_some([0]), TIMESTEP
    )
    said = ranked(search.tried, row_of=lambda change: "slips" if change.ids else None)
    assert {each.tried.change.change: each.row for each in said} == {
        "geom_friction": "slips",
        "option.timestep": None,
    }


def test_operators_of_one_field_are_one_outcome_said_by_what_moves_least_besides() -> None:
    gears = [Change("actuator_gear", op, how_of(op), (0,), ("lift",)) for op in ("*10", "*-1")]
    other = Change("actuator_gear", "*10", how_of("*10"), (1,), ("turn",))
    aside = {("*10", (0,)): 0.3, ("*-1", (0,)): 0.1, ("*10", (1,)): 0.2}
    runs = Runs(
        lambda change: 0.5 + aside[change.op, change.ids],
        lambda change: aside[change.op, change.ids],
    )
    said = ranked(searched(runs, *gears, other).tried)
    assert [each.tried.change for each in said] == [gears[1], other]
    assert [[one.change.op for one in each.also] for each in said] == [["*10"], []]


def test_what_follows_a_command_worse_comes_after_what_follows_it_as_before() -> None:
    def run(changes: Iterator[Change]) -> Iterator[tuple[Change, ChangeOutcome]]:
        for change in changes:
            is_timestep = change == TIMESTEP
            moved = replace(motion(0.5, 0.1), astray={"knee": 0.05 if is_timestep else 0.03})
            moved = (
                moved if is_timestep else replace(moved, positions_m=motion(0.5, 0.3).positions_m)
            )
            yield change, ChangeOutcome(True, 0.2, 0.5, [moved])

    own = replace(motion(0.1), astray={"knee": 0.02})
    search = Search(ChangeOutcome(False, -0.2, 0.1, [own]), run)
    search.all_of([TIMESTEP, FRICTION.of_some([0])])
    said = ranked(search.tried)
    assert [[*each.tried.worse] for each in said] == [[], ["knee"]]
    assert said[0].side_m > said[1].side_m


def test_where_ten_times_is_too_much_its_root_is_tried() -> None:
    """A motor has a third of the needed strength; ten times that throws the cube; √10 works."""
    heights = {"*10": -0.4, "*3.16": 0.5}
    gear = Change("actuator_gear", "*10", ("*", 10.0), (0, 1), ("lift", "turn"))
    runs = Runs(lambda change: heights.get(change.op, 0.1) if len(change.ids) == 2 else 0.1)
    (said,) = ranked(searched(runs, gear, TIMESTEP).tried)
    assert (said.tried.change.op, said.tried.change.ids) == ("*3.16", (0, 1))
    found = [each.op for each in runs.made]
    searched(again := Runs(lambda change: 0.5 if change == TIMESTEP else 0.2), gear, TIMESTEP)
    assert "*3.16" in found
    assert "*3.16" not in [each.op for each in again.made]  # something makes it true as it is


def test_a_factor_between_a_root_and_its_factor_is_tried() -> None:
    """Commands at a fifth of their size lift the cube at five times, between √10 and 10."""
    heights = {"*10": 0.15, "*3.16": 0.28, "*5.62": 0.5}
    ctrl = Change("input.ctrl", "*10", ("*", 10.0), (0, 1), ("lift", "turn"))
    gear = Change("actuator_gear", "*10", ("*", 10.0), (0, 1), ("lift", "turn"))
    small = {"*10": 0.2, "*3.16": 0.15}  # which only moves it the more, the larger it is
    runs = Runs(
        lambda change: (
            (heights if change.change == "input.ctrl" else small).get(change.op, 0.1)
            if len(change.ids) == 2
            else 0.1
        )
    )
    (said,) = ranked(searched(runs, ctrl, gear).tried)
    assert said.tried.change.op == "*5.62"
    assert "*1.78" in [each.op for each in runs.made if each.change == "input.ctrl"]
    assert "*5.62" not in [each.op for each in runs.made if each.change == "actuator_gear"]


def test_commands_that_change_places_are_no_commands_one_by_one() -> None:
    swap = Change("input.ctrl", "exchanged", how_of("exchanged"), (0, 1), ("lift", "turn"))
    runs = Runs(lambda _: 0.5)
    searched(runs, swap)
    assert runs.made == [swap]


def test_the_least_factor_that_does_it_is_found() -> None:
    runs = Runs(lambda change: 0.1 * change.how[1])
    search = searched(runs, FRICTION.of_some([0]))
    least = search.least_of(search.tried[0])
    assert least is not None
    assert 3 < least < 3 * 10 ** (1 / 16)
    assert f"{least:.3g}" == f"{least}"
    assert FRICTION.of_some([0]).by(least) in runs.made


@pytest.mark.parametrize(("most", "alone"), [(10.2, True), (10.6, False), (100.0, False)])
def test_a_factor_with_none_close_by_that_does_it_is_a_coincidence(
    most: float, alone: bool
) -> None:
    runs = Runs(lambda change: 0.5 if 9.8 < change.how[1] < most else 0.1)
    search = searched(runs, FRICTION.of_some([0]))
    assert search.tried[0].outcome.holds
    assert search.is_alone(search.tried[0]) is alone


def test_a_converted_unit_is_no_coincidence() -> None:
    (angle,) = (
        each
        for each in changes_of(b"""URDF = '<origin rpy="0 90 0"/>'""", "s.py", "")
        if converts_unit(each)
    )
    runs = Runs(lambda change: 0.5 if change.op == angle.op else 0.1)
    search = searched(runs, angle)
    assert search.tried[0].outcome.holds
    assert not search.is_alone(search.tried[0])


def test_a_search_whose_time_runs_out_is_not_complete() -> None:
    assert not searched(Runs(lambda _: 0.1, most=1), FRICTION, TIMESTEP).complete
    assert searched(Runs(lambda _: 0.1), FRICTION, TIMESTEP).complete


def test_motions_are_compared_at_the_steps_that_both_have() -> None:
    """A body moves at 1 m/step, in 9 and in 4 steps: compared are steps 0, 4, 8 and 0, 4."""
    positions = np.zeros((9, 1, 9))
    positions[:, 0, ::3] = np.arange(9)[:, None]
    one = RunMotion(1, 9, ("cube",), {}, positions, 0.01)
    other = RunMotion(4, 8, ("cube",), {}, positions[::4][:2] + 3.0, 0.01)
    assert apart_m([one], [other])["cube"] == pytest.approx(3 * np.sqrt(3))
    half = RunMotion(2, 18, ("cube",), {}, positions + 3.0, 0.005)
    assert apart_m([one], [half])["cube"] == pytest.approx(3 * np.sqrt(3)), "at the same times"
    assert side_m({"cube": 3.0, "a": 3.0, "b": 4.0}, besides=["cube"]) == 5
    assert apart_m([one], [replace(other, bodies=("ball",))]).keys() == {"cube"}

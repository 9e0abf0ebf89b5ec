"""Random scenarios: every sample has its own random stream, and distributions are as specified."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from drop_physics.errors import ScenarioError
from drop_physics.scenario import Scenario
from drop_physics.sweeping.plan import plan_of, replay_command
from drop_physics.sweeping.sampling import variations_of

MANY = 4000


def draws(vary: str, samples: int = MANY, seed: int = 1) -> np.ndarray:
    plan = plan_of({}, samples=samples, seed=seed, vary=[vary])
    (field,) = {one.field for one in plan.variations}
    return np.array([plan.values(run)[field] for run in range(samples)])


# -- streams --------------------------------------------------------------------------------------


def test_a_sample_is_drawn_from_numpys_stream_of_its_index() -> None:
    plan = plan_of({}, samples=9, seed=42, vary=["height=uniform:0.5:2"])
    for sample in (0, 3, 8):
        stream = np.random.default_rng(np.random.SeedSequence(42, spawn_key=(sample,)))
        assert plan.values(sample) == {"height_m": stream.uniform(0.5, 2)}


def test_a_sample_depends_on_neither_order_nor_number_nor_the_other_samples() -> None:
    few = plan_of({}, samples=5, seed=1, vary=["height=uniform:1:2", "mass=normal:1:0.1"])
    many = plan_of({}, samples=500, seed=1, vary=["mass=normal:1:0.1", "height=uniform:1:2"])
    backwards = [many.values(run) for run in reversed(range(500))][::-1]
    assert [few.values(run) for run in range(5)] == backwards[:5]
    other = plan_of({}, samples=5, seed=2, vary=["height=uniform:1:2"])
    assert other.values(0) != few.values(0)


def test_the_same_samples_are_drawn_for_every_scenario_of_the_lists() -> None:
    plan = plan_of({"linear_damping": "0,0.1"}, samples=3, vary=["height=uniform:1:2"])
    heights = [plan.values(run)["height_m"] for run in range(6)]
    assert heights[:3] == heights[3:]
    assert len(set(heights)) == 3
    assert [plan.sample_of(run) for run in range(6)] == [0, 1, 2, 0, 1, 2]


# -- distributions --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("form", "mean", "spread"),
    [
        ("uniform:1:3", 2.0, 2 / math.sqrt(12)),
        ("normal:5:0.5", 5.0, 0.5),
        ("triangular:1:2:6", 3.0, math.sqrt((1 + 4 + 36 - 2 - 6 - 12) / 18)),
        ("exponential:2", 2.0, 2.0),
        # Normal, cut at its mean: the half-normal's sqrt(2/π) and 1 - 2/π.
        ("truncnormal:1:1:1:50", 1 + math.sqrt(2 / math.pi), math.sqrt(1 - 2 / math.pi)),
        # Mean and spread of the logarithm: ln(1e3)/2, a third of it over sqrt 3; ln 2 and 0.25.
        ("loguniform:1:1000", math.log(1000) / 2, math.log(1000) / math.sqrt(12)),
        ("lognormal:2:0.25", math.log(2), 0.25),
    ],
)
def test_mean_and_spread_are_the_distributions(form: str, mean: float, spread: float) -> None:
    values = draws(f"height={form}")
    if form.startswith("log"):
        values = np.log(values)
    # Five standard errors: of the mean spread/√n, of the spread at most 2 spread/√n here.
    error = 5 * spread / math.sqrt(MANY)
    assert abs(values.mean() - mean) < error
    assert abs(values.std() - spread) < 2 * error


def test_limits_are_kept_and_choices_are_all_taken() -> None:
    assert 0.5 <= draws("height=uniform:0.5:2").min() <= draws("height=uniform:0.5:2").max() <= 2
    cut = draws("height=truncnormal:1:1:0.9:1.2")
    assert 0.9 <= cut.min() < 0.91 < 1.19 < cut.max() <= 1.2
    assert set(draws("solver_iterations=integers:1:4")) == {1, 2, 3, 4}
    assert set(draws("gravity=choice:earth:moon:-3")) == {-9.81, -1.62, -3.0}
    assert set(draws("timestep=choice:1/240:1/480")) == {1 / 240, 1 / 480}
    assert set(draws("body=choice:cube_small.urdf:sphere_small.urdf")) == {
        "cube_small.urdf",
        "sphere_small.urdf",
    }


def test_one_component_of_a_vector_can_be_drawn() -> None:
    plan = plan_of({"velocity_m_s": "1,2,3"}, samples=2, vary=["velocity_z=normal:0:1"])
    x, y, z = plan.values(0)["velocity_m_s"]
    assert (x, y) == (1.0, 2.0)
    assert z != 3.0


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        (["height"], "NAME=DISTRIBUTION"),
        (["heigth=uniform:1:2"], "scenario option"),
        (["height=uniform:1"], "uniform:LOW:HIGH"),
        (["height=uniform:2:1"], "LOW < HIGH"),
        (["height=uniform:nan:1"], "LOW < HIGH"),
        (["height=loguniform:0:1"], "0 < LOW"),
        (["height=gauss:0:1"], "normal:MEAN:SPREAD"),
        (["height=normal:0:x"], "numbers"),
        (["height=choice:1:x"], "'x'"),
        (["mass=choice:1:-1"], "at least 1e-09"),
        (["body=uniform:1:2"], "choice"),
        (["velocity=uniform:1:2"], "choice"),
        (["solver_iterations=uniform:1:9"], "whole numbers"),
        (["height=truncnormal:0:1:50:60"], "8 SPREAD"),
        (["solver_iterations=integers:1:99999999999999999999"], "out of bounds"),
        (["velocity_z=uniform:-1e308:1e308"], "cannot be drawn"),
        (["height=uniform:1:2", "height=normal:1:1"], "twice"),
        (["velocity_z=normal:1:1", "velocity=choice:1,2,3:0,0,0"], "twice"),
    ],
)
def test_what_cannot_be_drawn_says_why(vary: Sequence[str], said: str) -> None:
    with pytest.raises(ScenarioError, match="vary") as raised:
        variations_of(vary)
    assert said in str(raised.value)


@pytest.mark.parametrize("how", [{"given": {"height_m": "1,-1"}}, {"vary": ["height=choice:1:-1"]}])
def test_a_height_below_the_floor_is_refused_unless_there_is_none(how: Any) -> None:
    given = how.get("given", {})
    vary = how.get("vary", ["mass=uniform:1:2"])
    with pytest.raises(ScenarioError, match="height_m must be above 0"):
        plan_of(given, samples=2, vary=vary)
    plan = plan_of(given | {"floor": False}, samples=2, vary=vary)
    assert not Scenario(**plan.values(0)).floor


def test_orientations_are_listed_by_semicolons_and_drawn_by_angle() -> None:
    plan = plan_of({"orientation": "0,0,0;1,0,0,0"})
    assert [plan.values(run)["orientation"] for run in range(2)] == [(0, 0, 0), (1, 0, 0, 0)]
    tilted = plan_of({"orientation": "0,10,0"}, samples=3, vary=["orientation_roll=uniform:1:2"])
    for run in range(3):
        roll, pitch, yaw = tilted.values(run)["orientation"]
        assert 1 <= roll < 2
        assert (pitch, yaw) == (10, 0)
    with pytest.raises(ScenarioError, match="must be angles"):
        plan_of({"orientation": "1,0,0,0"}, samples=3, vary=["orientation_roll=uniform:1:2"])


def test_a_run_is_replayed_in_its_orientation() -> None:
    q = Scenario(orientation=(1.0, 2.0, 3.0, 4.0)).orientation
    for orientation in ((0.1, 1 / 3, 7.0), q):
        words = replay_command({"orientation": orientation}, out="run.rrd").split()
        text = words[words.index("--orientation") + 1]
        assert Scenario.from_text({"orientation": text}).orientation == orientation


# -- lists ----------------------------------------------------------------------------------------


def test_lists_are_multiplied_in_the_order_of_the_options_the_last_fastest() -> None:
    plan = plan_of({"linear_damping": "default,0", "timestep_s": "1/240,1/480", "floor": False})
    assert [(v["timestep_s"], v["linear_damping"]) for v in map(plan.values, range(4))] == [
        (1 / 240, None),
        (1 / 240, 0.0),
        (1 / 480, None),
        (1 / 480, 0.0),
    ]
    assert all(plan.values(run)["floor"] is False for run in range(4))
    assert plan.axes == ("timestep_s", "linear_damping")


def test_lists_of_vectors_are_separated_by_semicolons() -> None:
    plan = plan_of({"velocity_m_s": "0,0,0; 0,0,-1"})
    assert [plan.values(run)["velocity_m_s"] for run in range(2)] == [(0, 0, 0), (0, 0, -1)]


@pytest.mark.parametrize(
    ("given", "how", "said"),
    [
        ({"height_m": "1,x"}, {}, "'x'"),
        ({"height_m": "1,,2"}, {}, "''"),
        ({"height_m": "1,-2"}, {}, "height_m must be"),
        ({"height_m": "1,2,1"}, {}, "once"),
        ({}, {"samples": 0}, "samples must be at least 1"),
        ({}, {"samples": 3}, "samples draws nothing without vary; add vary"),
        ({}, {"samples": 1, "seed": -1}, "seed must be"),
        ({}, {"vary": ["height=uniform:1:2"]}, "samples=1000"),
        ({"height_m": "1"}, {"samples": 2, "vary": ["height=uniform:1:2"]}, "leave one"),
    ],
)
def test_lists_that_cannot_be_read_say_why(given: dict, how: dict, said: str) -> None:
    with pytest.raises(ScenarioError) as raised:
        plan_of(given, **how)
    assert said in str(raised.value)


def test_the_replay_command_reads_back_as_the_same_scenario() -> None:
    plan = plan_of(
        {"floor": False, "linear_damping": "default", "body": "my own body.urdf"},
        samples=1,
        vary=["gravity=normal:-9:1", "spin_x=normal:-1e-9:1e-12"],
    )
    values = plan.values(0)
    words = shlex.split(replay_command(values, out="x.rrd"))
    assert words[:5] == ["drop", "simulate", "--out", "x.rrd", "--no-camera"]
    given: dict[str, str | bool | None] = {}
    names = {option.name: field for field, option in Scenario.options().items()}
    rest = iter(words[5:])
    for word in rest:
        given[names[word]] = False if word.startswith("--no-") else next(rest)
    assert Scenario.from_text(given) == Scenario(**values)

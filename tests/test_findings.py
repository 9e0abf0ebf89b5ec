"""Each finding is reported if and only if its cause is present, with the correct value."""

from __future__ import annotations

import re
from pathlib import Path

import polars as pl
import pytest
from conftest import Recorder, judge, said, some
from drop_physics.report.terminal import show
from engine import MODES, box, urdf_of

BOUNCY = 0.7**0.5
FAST = {"height_m": 2000.0, "linear_damping": 0.0, "duration_s": 12.0}
RESTLESS = {"restitution": 1.0, "contact_erp": 0.0, "duration_s": 0.6}

# Code -> a scenario that causes it, a word of its message, and a scenario that does not.
CASES: dict[str, tuple[dict[str, object], str, dict[str, object]]] = {
    "not-stepped": ({"stepped": False}, "241 samples", {}),
    "no-gravity": ({"gravity_set": False}, "1.0000 m", {}),
    "no-floor": ({"floor": False}, "-3.5783 m", {}),
    "default-damping": ({}, "from -1.82 to +4.31 mm", {"linear_damping": 0.04}),
    "velocity-clamped": (FAST, "reaches 100", {**FAST, "coordinates": "maximal"}),
    "deep-penetration": ({}, "8.8 mm", {"timestep_s": 1 / 960}),
    "rest-below-expected": ({}, "11.98 µm", {"duration_s": 0.3}),
    "restitution-inflated": (
        {"restitution": BOUNCY},
        "0.7 (body × floor)",
        {"restitution": BOUNCY, "contact_erp": 0.0},
    ),
    "bounce-swallowed": (
        {
            "restitution": 0.9,
            "height_m": 0.1,
            "timestep_s": 1 / 960,
            "solver_residual": 0.0,
            "duration_s": 2.0,
        },
        "0.2 m/s",
        RESTLESS,
    ),
    "tumbled": (
        {"restitution": 0.8, "duration_s": 2.0},
        "step 347",
        {"restitution": 0.8, "duration_s": 2.0, "solver_residual": 0.0},
    ),
    "starts-in-contact": ({"height_m": 0.01}, "15 mm inside", {"height_m": 0.0251}),
    "tunnelled": ({"timestep_s": 1.0}, "-8.8100 m", {"timestep_s": 1 / 60}),
    "still-airborne": ({"gravity_m_s2": -1.62}, "0.2057 m", {}),
}


@pytest.mark.parametrize("code", some(CASES, 5))
def test_a_finding_names_its_number_and_what_changes_it(recorded: Recorder, code: str) -> None:
    provoking, number, _ = CASES[code]
    messages = {finding.code: said(finding) for finding in judge(recorded(**provoking)).findings}
    assert code in messages
    assert number in messages[code]
    assert code == "tumbled" or re.search(r"--[a-z]|p\.[a-zA-Z]+", messages[code])


@pytest.mark.parametrize("code", some(CASES, 2))
def test_a_finding_is_not_reported_without_its_cause(recorded: Recorder, code: str) -> None:
    *_, innocent = CASES[code]
    assert code not in [finding.code for finding in judge(recorded(**innocent)).findings]


def test_a_cure_is_the_scenarios_option(recorded: Recorder) -> None:
    """A suggested change for a drop has the same form as one for a script."""
    standard, weightless = judge(recorded()), judge(recorded(gravity_set=False))
    cures = {
        each.code: (each.cure.name, each.cure.value, each.cure.call)
        for each in (*standard.findings, *weightless.findings)
        if each.cure is not None
    }
    assert cures == {
        "deep-penetration": ("timestep", 4.0, "--timestep 1/960"),
        "default-damping": ("damping", 0.0, "--linear-damping 0"),
        "no-gravity": ("gravity", -9.81, "omit --no-gravity"),
    }


def test_intended_weightlessness_is_not_a_mistake(recorded: Recorder) -> None:
    codes = {finding.code for finding in judge(recorded(gravity_m_s2=0.0)).findings}
    assert not codes & {"no-gravity", "not-stepped", "still-airborne"}


def test_the_three_mistakes_are_told_apart(recorded: Recorder) -> None:
    mistakes = {"not-stepped": "stepped", "no-gravity": "gravity_set", "no-floor": "floor"}
    for code, field in mistakes.items():
        codes = {finding.code for finding in judge(recorded(**{field: False})).findings}
        assert codes & set(mistakes) == {code}


@pytest.mark.parametrize(
    ("column", "step", "by"),
    [("z_m", 50, 1e-12), ("vz_m_s", 108, 1e-12), ("x_m", 3, 1e-300), ("vy_m_s", 1, -1e-9)],
)
def test_an_altered_state_does_not_follow_the_law(
    recorded: Recorder, column: str, step: int, by: float
) -> None:
    recording = recorded()
    altered = recording.states.with_columns(
        pl.when(pl.col("step") == step)
        .then(pl.col(column) + by)
        .otherwise(pl.col(column))
        .alias(column)
    )
    analysis = judge(recording, altered)
    (message,) = [said(finding) for finding in analysis.findings if finding.code == "law-mismatch"]
    assert f"sample {step} " in message
    assert analysis.coverage.samples == step
    assert "law-mismatch" not in [finding.code for finding in judge(recording).findings]


def test_an_engine_with_another_law_is_noticed(recorded: Recorder) -> None:
    """The recording claims the default damping, but was made with another."""
    other = recorded(linear_damping=0.05)
    named = recorded()
    analysis = judge(named, other.states, other.contacts)
    assert "law-mismatch" in [finding.code for finding in analysis.findings]


@pytest.mark.parametrize(("rate", "deep"), [(240, True), (300, True), (480, False)])
def test_a_tenth_of_its_height_is_deep(recorded: Recorder, rate: int, deep: bool) -> None:
    """The body sinks in by 18 %, 14 % and 8 % of its 5 cm."""
    codes = [finding.code for finding in judge(recorded(timestep_s=1 / rate)).findings]
    assert ("deep-penetration" in codes) == deep


@pytest.mark.parametrize("height_m", some([0.9, 1.1], 2))
@pytest.mark.parametrize("body", ["cube_small.urdf", "block.urdf"])
def test_as_short_a_step_as_is_advised_lets_a_body_sink_less(
    recorded: Recorder, body: str, height_m: float
) -> None:
    """The landing's position within a step is chance: a slightly shorter step may be worse."""
    drop = {"body": body, "height_m": height_m, "duration_s": 0.6}
    (message,) = (
        said(finding)
        for finding in judge(recorded(**drop, timestep_s=1 / 60)).findings
        if finding.code == "deep-penetration"
    )
    times = re.search(r"use a timestep (\d+) times shorter", message)
    assert times is not None
    short = judge(recorded(**drop, timestep_s=1 / 60 / int(times[1])))
    assert "deep-penetration" not in [finding.code for finding in short.findings]


def test_inflated_is_relative_to_the_restitution_asked_for(recorded: Recorder) -> None:
    """An excess of 0.0044 is 4.9 % of 0.09, and 0.5 % of 0.81."""
    low, high = (
        judge(recorded(restitution=e, contact_erp=0.008, solver_residual=0.0, duration_s=0.7))
        for e in (0.3, 0.9)
    )
    for analysis, inflated in ((low, True), (high, False)):
        (bounce, *_) = analysis.bounces
        assert bounce.effective_restitution is not None
        asked = analysis.engine.pair_restitution
        assert 0 < bounce.effective_restitution - asked < 0.0081
        assert (
            "restitution-inflated" in [finding.code for finding in analysis.findings]
        ) == inflated


@pytest.mark.parametrize("coordinates", MODES)
def test_a_contact_that_is_a_spring_is_not_explained_by_the_solver(
    recorded: Recorder, tmp_path: Path, coordinates: str
) -> None:
    """The four corners give way by m g / 4 k; only the URDF's contact stiffness is reported."""
    spring = '<stiffness value="300"/><damping value="10"/>'
    body = urdf_of(tmp_path, box("0.1 0.2 0.06"), contact=spring)
    analysis = judge(recorded(body=body, duration_s=3.0, restitution=0.9, coordinates=coordinates))
    assert analysis.engine.contact_stiffness_n_m == 300
    assert analysis.engine.contact_damping_n_s_m == 10
    assert analysis.rest is not None
    assert analysis.rest.error_m == pytest.approx(-9.81 / 1200, rel=0.01)
    assert analysis.rest.terms_m is None
    assert analysis.contact is None
    assert not any(bounce.effective_restitution for bounce in analysis.bounces)
    unsure = {"rest-below-expected", "restitution-inflated", "bounce-swallowed"}
    assert not unsure & {finding.code for finding in analysis.findings}


@pytest.mark.parametrize("residual", some([None, 0.0], 1))
def test_more_iterations_remove_what_few_leave(recorded: Recorder, residual: float | None) -> None:
    drop = {"body": "cube.urdf", "height_m": 1.2193473333214817, "coordinates": "maximal"}
    few = judge(recorded(**drop, duration_s=3.0, solver_iterations=5, solver_residual=residual))
    many = judge(recorded(**drop, duration_s=3.0, solver_iterations=500, solver_residual=0.0))
    (message,) = (
        said(finding) for finding in few.findings if finding.code == "rest-below-expected"
    )
    assert "more --solver-iterations remove" in message
    assert few.rest is not None
    assert many.rest is not None
    assert few.rest.error_m == pytest.approx(-14.67e-6, abs=1e-7)
    assert many.rest.error_m == pytest.approx(-10e-6, abs=1e-9)


def test_a_correction_adds_as_much_in_shorter_steps(recorded: Recorder) -> None:
    """A correction adds up to ERP × speed, wherever the body lands in a step: only ERP 0 helps."""
    drop = {"body": "block.urdf", "gravity_m_s2": -3.71, "restitution": 0.5, "duration_s": 0.8}
    added = []
    for rate in (240, 480):
        analysis = judge(recorded(**drop, timestep_s=1 / rate))
        assert "restitution-inflated" in {finding.code for finding in analysis.findings}
        added.append(analysis.bounces[0].correction_m_s)
    assert added[1] > 5 * added[0]
    without = judge(recorded(**drop, timestep_s=1 / 480, contact_erp=0.0)).bounces[0]
    assert without.effective_restitution == pytest.approx(0.25, rel=1e-4)


def test_an_unknown_landing_is_not_reported(recorded: Recorder) -> None:
    """The body moves at the limit of 100 m/s, and misses the floor's edge."""
    fast = {"height_m": 10.0, "linear_damping": 0.0, "velocity_m_s": (150.0, 0.0, 0.0)}
    messages = {
        finding.code: said(finding) for finding in judge(recorded(**fast, duration_s=0.5)).findings
    }
    assert "nothing has touched yet" in messages["still-airborne"]
    later = {finding.code for finding in judge(recorded(**fast, duration_s=3.0)).findings}
    assert not later & {"still-airborne", "tunnelled"}


def test_the_depth_within_substeps_is_not_reported(recorded: Recorder) -> None:
    """With every substep of the same motion recorded, it is deeper than in any tenth sample."""
    fast = {"velocity_m_s": (0.0, 0.0, -90.0), "height_m": 1.0, "duration_s": 0.1}
    seen = judge(recorded(**fast, timestep_s=1 / 4800))
    hidden = judge(recorded(**fast, timestep_s=1 / 480, substeps=10))
    assert seen.impact is not None
    assert hidden.impact is not None
    assert seen.impact.lowest_m < hidden.impact.lowest_m
    assert seen.impact.penetration_m is not None
    assert hidden.impact.penetration_m is None
    assert "deep-penetration" not in {finding.code for finding in hidden.findings}


def test_a_contact_of_several_substeps_and_joints_is_not_denied(
    recorded: Recorder, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = recorded(body="r2d2.urdf", substeps=2, height_m=0.6)
    assert len(recording.contacts)
    analysis = judge(recording)
    assert analysis.impact is None
    show(analysis, as_json=False)
    assert "Impact      time unknown" in capsys.readouterr().out


@pytest.mark.parametrize("duration_s", [100.0, 1000.0])
def test_a_body_that_passes_the_floor_in_each_step_is_not_still_airborne(
    recorded: Recorder, duration_s: float
) -> None:
    """Steps of 10 s take the body to -980 m and, by Bullet's damping, back, for ever."""
    recording = recorded(timestep_s=10.0, duration_s=duration_s)
    heights_m = recording.states["z_m"].to_numpy()
    assert len(recording.contacts) == 0
    assert heights_m[1:4].tolist() == pytest.approx([-980, 20, -980], abs=1e-6)
    assert heights_m[-1] > 0
    codes = {finding.code: said(finding) for finding in judge(recording).findings}
    assert "still-airborne" not in codes
    assert "shorter timestep" in codes["tunnelled"]

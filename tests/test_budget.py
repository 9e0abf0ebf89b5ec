"""Verification: the terms of a position error are as theory predicts, and add up to the error."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Recorder, judge, some
from drop_physics.drop.analysis import fall_of
from drop_physics.drop.case import DropCase
from drop_physics.drop.mechanics import Drift, mechanics_of_part
from drop_physics.explain.decomposition import decompose
from drop_physics.physics.base import Motion
from drop_physics.recording.reader import Recording
from drop_physics.stages.analyze.events import events
from drop_physics.trace.history import HeldSamples
from drop_physics.trace.states import between
from iterated import law_of, thrown_as
from numpy.typing import NDArray

pytestmark = pytest.mark.pybullet

TERMS = ("timestep_m", "damping_m", "interaction_m", "rounding_m")

SCENARIOS: dict[str, dict[str, object]] = {
    "standard": {},
    "1/60": {"timestep_s": 1 / 60},
    "1/960": {"timestep_s": 1 / 960},
    "odd step": {"timestep_s": 0.003, "duration_s": 0.3},
    "no damping": {"linear_damping": 0.0},
    "tiny damping": {"linear_damping": 1e-12},
    "small damping": {"linear_damping": 1e-6},
    "large damping": {"linear_damping": 0.9},
    "Moon": {"gravity_m_s2": -1.62},
    "no gravity": {"gravity_m_s2": 0.0, "velocity_m_s": (0.0, 0.0, -2.0)},
    "upward gravity": {"gravity_m_s2": 3.0, "velocity_m_s": (0.0, 0.0, -1.0), "floor": False},
    "heavy": {"mass_kg": 1234.5},
    "light": {"mass_kg": 1e-4},
    "thrown up": {"velocity_m_s": (0.0, 0.0, 3.0)},
    "thrown down": {"velocity_m_s": (0.0, 0.0, -5.0)},
    "oblique": {"velocity_m_s": (3.0, -2.0, 4.0)},
    "spinning": {"spin_rad_s": (3.0, -2.0, 10.0)},
    "oblique and spinning": {"velocity_m_s": (3.0, 0.0, 1.0), "spin_rad_s": (9.0, 1.0, 0.0)},
    "high": {"height_m": 100.0, "duration_s": 4.0},
    "maximal": {"coordinates": "maximal"},
    "maximal, damped": {"coordinates": "maximal", "linear_damping": 0.3},
    "maximal, oblique": {"coordinates": "maximal", "linear_damping": 0.04,
                         "velocity_m_s": (3.0, -2.0, 4.0)},
    "clamped": {"height_m": 200.0, "linear_damping": 0.0, "velocity_m_s": (0.0, 0.0, -95.0)},
}  # fmt: skip


@pytest.mark.parametrize("name", some(SCENARIOS, 5))
def test_the_terms_add_up_and_only_rounding_is_unexplained(recorded: Recorder, name: str) -> None:
    analysis = judge(recorded(**SCENARIOS[name]))
    table = analysis.table.head(analysis.coverage.samples)
    assert analysis.coverage.samples > 10
    total = table["error_m"].to_numpy()
    terms = table.select(TERMS).to_numpy()
    # One rounding of the largest number involved: the height for the error, the largest term.
    scale = np.maximum(1.0, np.abs(terms).max(axis=1))
    height = np.maximum(1.0, np.abs(table["free_fall_m"].to_numpy()))
    assert np.all(np.abs(terms.sum(axis=1) - total) <= 1e-15 * np.maximum(scale, height))
    # Doubles are as coarse as the largest height passed, wherever the body is by then.
    reach = np.maximum.accumulate(height)
    assert np.all(np.abs(terms[:, 3]) <= 1e-14 * reach)
    assert [finding.code for finding in analysis.findings].count("law-mismatch") == 0


@pytest.mark.parametrize(
    ("timestep_s", "total", "timestep", "damping", "interaction", "rounding"),
    [
        (1 / 240, -0.001820347613623, -0.00613125, 0.004310219835131, 6.8255e-7, -2.8e-16),
        (1 / 480, 0.001245143340375, -0.003065625, 0.004310219835131, 5.4851e-7, 2e-17),
        (1 / 960, 0.002777733377185, -0.0015328125, 0.004310219835131, 3.2604e-7, -8e-17),
    ],
)
def test_golden_terms_at_three_tenths_of_a_second(
    recorded: Recorder,
    timestep_s: float,
    total: float,
    timestep: float,
    damping: float,
    interaction: float,
    rounding: float,
) -> None:
    (moment,) = judge(recorded(timestep_s=timestep_s)).at
    terms = moment.terms_m
    assert terms is not None
    assert moment.error_m == pytest.approx(total, abs=1e-15)
    assert terms.timestep == pytest.approx(timestep, abs=1e-15)
    assert terms.damping == pytest.approx(damping, abs=2e-15)
    assert terms.interaction == pytest.approx(interaction, abs=5e-12)
    assert terms.rounding == pytest.approx(rounding, abs=2e-17)


def test_the_timestep_term_is_signed_and_exact_without_damping(recorded: Recorder) -> None:
    """Semi-implicit Euler lags by exactly g t dt / 2; explicit Euler would lead by it."""
    table = judge(recorded(linear_damping=0.0)).table.head(100)
    time_s = table["time_s"].to_numpy()
    # 100 additions of numbers up to 1 m, each rounded to half of 2.2e-16 m, and two in theory.
    assert np.allclose(table["error_m"], -9.81 * time_s / 480, rtol=0, atol=2e-15)
    assert np.abs(table["interaction_m"].to_numpy()).max() < 5e-16


def test_four_recordings_give_the_same_budget_without_any_theory(recorded: Recorder) -> None:
    """Damping on and off, at dt and dt/2, extrapolated to dt = 0 (Richardson, first order)."""
    at, fine = 72, 144
    on, off = recorded().states["z_m"][at], recorded(linear_damping=0.0).states["z_m"][at]
    on2 = recorded(timestep_s=1 / 480).states["z_m"][fine]
    off2 = recorded(timestep_s=1 / 480, linear_damping=0.0).states["z_m"][fine]
    limit_on, limit_off = 2 * on2 - on, 2 * off2 - off
    timestep, damping = off - limit_off, limit_on - limit_off
    interaction = (on - limit_on) - (off - limit_off)
    (moment,) = judge(recorded()).at
    assert moment.terms_m is not None
    # Extrapolation leaves the second-order term, all of it in damping × timestep.
    assert timestep == pytest.approx(moment.terms_m.timestep, abs=1e-15)
    assert damping == pytest.approx(moment.terms_m.damping, abs=4.2e-7)
    assert interaction == pytest.approx(moment.terms_m.interaction, abs=4.2e-7)
    assert timestep + damping + interaction == pytest.approx(on - limit_off, abs=1e-15)


def test_what_is_not_covered_gets_no_number(recorded: Recorder) -> None:
    analysis = judge(recorded(), at_s=[0.3, 0.5])
    after = analysis.table.filter(analysis.table["step"] >= 108)
    assert after.select(TERMS).null_count().row(0) == (133,) * 4
    assert analysis.at[1].terms_m is None
    assert analysis.coverage.samples == 108
    assert "free fall has reached the floor" in analysis.coverage.why


def test_theory_ends_where_free_fall_reaches_the_floor(recorded: Recorder) -> None:
    """At sample 108 the simulated box is still above the floor's push, free fall is not."""
    analysis = judge(recorded())
    heights_m = analysis.table["free_fall_m"].to_numpy()
    assert heights_m.min() == 0.025
    assert heights_m[107] > 0.025 == heights_m[108]
    error_m = np.abs(analysis.table["error_m"].to_numpy()[:108])
    assert analysis.airborne.max_abs_error_m == error_m.max()


def test_a_velocity_that_is_held_is_not_booked_as_an_interaction(recorded: Recorder) -> None:
    analysis = judge(recorded(velocity_m_s=(0.0, 0.0, 150.0), floor=False))
    assert analysis.coverage.samples == 1
    assert "limit of 100" in analysis.coverage.why
    # The first step: 150 m/s minus damping and gravity, then limited to 100.
    causes = causes_of(recorded(velocity_m_s=(0.0, 0.0, 150.0), floor=False))
    assert causes["clamp"] < -0.1 / 2 * (140**2 - 100**2)
    assert abs(causes["remainder"]) < 1e-9 * abs(causes["clamp"])


@pytest.mark.parametrize(
    "scenario",
    [
        {"body": "cube.urdf", "spin_rad_s": (1.0, 2.0, 3.0), "duration_s": 2.0},
        {"body": "cube.urdf", "restitution": 0.9, "duration_s": 2.0},
        {"body": "jenga/jenga.urdf", "spin_rad_s": (0.0, 5.0, 0.0), "restitution": 0.5},
    ],
)
def test_where_an_edge_was_deeper_the_centre_does_not_say_how_deep(
    recorded: Recorder, scenario: dict[str, Any]
) -> None:
    recording = recorded(**scenario)
    edge_m = -recording.contacts["distance_m"].min()
    impact = judge(recording).impact
    assert impact is not None
    assert recording.engine.rest_height_m is not None
    assert edge_m > recording.engine.rest_height_m - impact.lowest_m + 1e-4
    assert impact.penetration_m is None


def test_numbers_of_things_are_the_same_as_json(recorded: Recorder) -> None:
    """Messages with counts survive the conversion to JSON."""
    analysis = judge(recorded(restitution=0.9, height_m=0.1, timestep_s=1 / 960, duration_s=2.0))
    messages = [finding.message for finding in analysis.findings]
    assert messages
    assert [one["message"] for one in analysis.as_json()["findings"]] == messages


def test_an_apex_of_one_sample_is_counted(recorded: Recorder) -> None:
    """A bounce that leaves the floor for a single sample counts as a bounce."""
    drop = {
        "body": "cube.urdf",
        "height_m": 2.493832761794609,
        "timestep_s": 0.01,
        "duration_s": 2.0,
        "restitution": 0.7,
        "gravity_m_s2": -20.0,
    }
    without = judge(recorded(**drop, contact_erp=0.0, solver_residual=0.0)).bounces
    for said, bounce in zip(judge(recorded(**drop)).bounces[:5], without, strict=False):
        assert said.uncorrected_apex_m == pytest.approx(bounce.apex_m, rel=1e-9)


def test_a_spin_that_is_held_is_not_booked_as_damping(recorded: Recorder) -> None:
    """The first step reduces 150 rad/s by damping, and then clamps it to 100."""
    for damping in (0.0, 0.04):
        spun = {"spin_rad_s": (0.0, 0.0, 150.0), "angular_damping": damping, "duration_s": 0.3}
        recording = recorded(**spun, linear_damping=0.0)
        causes, inertia_kg_m2 = causes_of(recording), recording.engine.inertia_kg_m2[2]
        damped = 150 - damping / 240 * 150 * (1 + 150)
        # Each takes its share of the step's mean spin: the sum is the same in any order.
        first_j = inertia_kg_m2 / 2 * (100**2 - 150**2)
        share = (100 - damped) / (100 - 150)
        assert causes["clamp"] == pytest.approx(first_j * share, rel=1e-9)
        assert (causes["damping"] == 0) == (damping == 0)


def test_a_body_with_joints_is_left_out_loudly(recorded: Recorder) -> None:
    analysis = judge(recorded(body="r2d2.urdf", duration_s=0.1))
    assert "law-mismatch" not in {finding.code for finding in analysis.findings}
    assert analysis.coverage.samples == 0
    assert "15 joints" in analysis.coverage.why
    assert analysis.at == []
    assert analysis.airborne.samples == 0
    assert analysis.airborne.max_abs_error_m is None


def test_a_landing_that_is_not_flat_gets_no_prediction(recorded: Recorder) -> None:
    """A spinning box lands on an edge and tumbles: no formula predicts where it comes to rest."""
    analysis = judge(recorded(spin_rad_s=(4.0, 7.0, 0.0), duration_s=3.0))
    assert analysis.coverage.samples < analysis.coverage.of
    assert analysis.contact is None
    assert analysis.impact is not None
    assert analysis.impact.time_free_fall_s is None
    assert analysis.impact.penetration_m is None
    assert analysis.rest is not None
    assert analysis.rest.terms_m is None
    assert analysis.rest.expected_m == 0.025


def test_a_box_that_fell_over_is_expected_on_the_face_it_lies_on(recorded: Recorder) -> None:
    rest = judge(recorded(body="jenga/jenga.urdf", spin_rad_s=(9.0, 0.0, 0.0), duration_s=4.0)).rest
    assert rest is not None
    assert rest.expected_m in (0.075, 0.025, 0.015)
    assert rest.error_m == pytest.approx(-1e-5, abs=5e-6)


def test_samples_from_the_middle_are_broken_down_as_in_the_whole_fall(recorded: Recorder) -> None:
    recording, law = recorded(), law_of()
    position_m = recording.states.select("x_m", "y_m", "z_m").to_numpy()[:100]
    whole = decompose(law, thrown_as(law), position_m)
    later = decompose(law, thrown_as(law), position_m[40:], first=40)
    for name, values in vars(whole).items():
        assert np.array_equal(vars(later)[name], values[40:]), name


# -- impact, contact, rest ------------------------------------------------------------------------


def test_the_impact_is_where_theory_and_samples_have_it(recorded: Recorder) -> None:
    impact = judge(recorded()).impact
    assert impact is not None
    assert impact.time_free_fall_s == pytest.approx(math.sqrt(2 * 0.975 / 9.81), abs=1e-15)
    assert impact.time_free_fall_s == pytest.approx(0.4458438722, abs=1e-10)
    assert impact.time_damped_s == pytest.approx(0.4500868681, abs=1e-10)
    z = recorded().states["z_m"]
    crossing = (107 + (z[107] - 0.025) / (z[107] - z[108])) / 240
    assert impact.time_simulated_s == pytest.approx(crossing, abs=1e-15)
    assert (impact.lowest_step, impact.step) == (108, 109)
    assert impact.penetration_m == pytest.approx(0.025 - 0.01618091982485528, abs=1e-15)
    assert impact.penetration_m < impact.speed_m_s / 240


def test_events_are_reported_at_the_step_at_which_they_happen(recorded: Recorder) -> None:
    """The box is deepest at step 108, where it first touches: first contact is reported there."""
    analysis = judge(recorded(), at_s=[0.3])
    happened = [(step, line) for step, _, line in events(analysis)]
    assert [step for step, _ in happened] == sorted(step for step, _ in happened)
    steps = {word: step for step, line in happened for word in line.replace(",", " ").split()}
    assert analysis.rest is not None
    assert (steps["release"], steps["damping"], steps["lowest"], steps["contact"]) == (
        0,
        72,
        108,
        108,
    )
    lines = [line for _, line in happened]
    (contact, *_), (lowest, *_) = (
        [at for at, line in enumerate(lines) if word in line] for word in ("contact", "lowest")
    )
    assert contact < lowest
    assert happened[-1][0] == analysis.rest.settled_step


@pytest.mark.parametrize(
    ("restitution", "timestep_s"), [(None, 1 / 60), (None, 1 / 480), (0.9, 1 / 240), (0.9, 1 / 960)]
)
def test_the_contact_law_is_the_engines_where_the_solver_runs_to_its_end(
    recorded: Recorder, timestep_s: float, restitution: float | None
) -> None:
    recording = recorded(timestep_s=timestep_s, restitution=restitution, solver_residual=0.0)
    contact = judge(recording).contact
    assert contact is not None
    assert contact.max_deviation_m <= 1e-13


def test_rest_is_explained_in_micrometres(recorded: Recorder) -> None:
    rest = judge(recorded()).rest
    assert rest is not None
    assert rest.terms_m is not None
    terms = rest.terms_m
    assert rest.error_m * 1e6 == pytest.approx(-11.98, abs=0.005)
    assert terms.slop * 1e6 == pytest.approx(-10.00, abs=0.005)
    assert terms.solver * 1e6 == pytest.approx(-1.84, abs=0.005)
    assert terms.settling * 1e6 == pytest.approx(-0.15, abs=0.005)
    assert terms.slop + terms.solver + terms.settling == pytest.approx(rest.error_m, abs=1e-17)
    exact = judge(recorded(solver_residual=0.0)).rest
    assert exact is not None
    assert exact.terms_m is not None
    assert abs(exact.terms_m.solver) < 1e-13


def test_bounces_rise_as_theory_says_once_the_correction_is_off(recorded: Recorder) -> None:
    plain = recorded(restitution=math.sqrt(0.5), timestep_s=1 / 960, duration_s=1.5)
    exact = recorded(
        restitution=math.sqrt(0.5),
        timestep_s=1 / 960,
        duration_s=1.5,
        contact_erp=0.0,
        linear_damping=0.0,
        solver_residual=0.0,
    )
    (inflated, *_), (bounce, *_) = judge(plain).bounces, judge(exact).bounces
    assert bounce.effective_restitution == pytest.approx(0.5, abs=1e-12)
    assert bounce.correction_m_s == pytest.approx(0.0, abs=1e-12)
    assert bounce.predicted_apex_m == pytest.approx(0.25 * 0.975, abs=1e-12)
    assert bounce.apex_m == pytest.approx(0.25 * 0.975, rel=0.02)
    assert 0.5 < inflated.effective_restitution < 0.58
    assert inflated.correction_m_s > 0
    assert [bounce.predicted_apex_m for bounce in judge(exact).bounces[:2]] == pytest.approx(
        [0.5**2 * 0.975, 0.5**4 * 0.975]
    )


# -- conservation ---------------------------------------------------------------------------------


def causes_of(recording: Recording) -> dict[str, float]:
    """Return the contributions to the body's change of energy by cause [J]; they add up to it."""
    energy = judge(recording).bodies[0].energy
    assert energy is not None
    change_j = energy.end_j - energy.start_j
    assert math.fsum(energy.by_cause_j.values()) == pytest.approx(change_j, abs=1e-12)
    return energy.by_cause_j


def test_every_joule_is_booked_to_a_cause(recorded: Recorder) -> None:
    """The energy that the integrator adds during the fall is taken back when the box stops."""
    causes = causes_of(recorded())
    assert causes["contacts"] == pytest.approx(-0.9090126, abs=5e-8)
    assert causes["damping"] == pytest.approx(-0.0474, abs=2e-4)
    assert abs(causes["integrator"]) < 1e-8
    assert abs(causes["remainder"]) < 1e-12
    assert judge(recorded()).contact_j == pytest.approx(causes["contacts"], rel=1e-6)


@pytest.mark.parametrize("floor", [True, False])
def test_what_a_spin_loses_in_the_air_is_damping(recorded: Recorder, floor: bool) -> None:
    recording = recorded(
        body="sphere_small.urdf",
        spin_rad_s=(30.0, 0.0, 50.0),
        angular_damping=0.5,
        floor=floor,
        linear_damping=0.0,
    )
    spin_j, causes = judge(recording).table["kinetic_angular_j"].to_numpy(), causes_of(recording)
    if floor:
        assert causes["contacts"] < -0.1
    else:
        assert causes["damping"] == pytest.approx(spin_j[-1] - spin_j[0], rel=1e-9)
        assert causes["contacts"] == 0


def test_without_a_step_no_energy_changes(recorded: Recorder) -> None:
    recording = recorded(stepped=False, velocity_m_s=(0.0, 0.0, 3.0))
    (initial_j,) = judge(recording).table["energy_j"].unique()
    assert initial_j == pytest.approx(0.981 + 0.1 * 9 / 2)
    assert judge(recording).bodies[0].energy is None
    assert judge(recording).contact_j == 0


def test_the_drift_is_the_largest_on_the_way_whatever_its_sign() -> None:
    def relative(values: NDArray[np.float64]) -> float | None:
        drift = Drift()
        drift.add(values[:2])
        drift.add(values[2:])
        return drift.relative

    assert relative(np.array([2.0, 3.0, 0.5, 2.0])) == 0.75
    assert relative(np.array([-2.0, -3.0, -2.0])) == 0.5
    vectors = np.array([[3.0, 0.0, 4.0], [3.0, 1.0, 4.0], [3.0, 0.0, 4.0]])
    assert relative(vectors) == pytest.approx(0.2)
    assert relative(np.zeros((4, 3))) is None
    assert Drift().relative is None


def test_undamped_energy_less_its_integrator_term_is_conserved(recorded: Recorder) -> None:
    """Airborne and undamped, E - m g dt v / 2 is constant (g = 9.81, v negative downwards)."""
    recording = recorded(linear_damping=0.0)
    table = judge(recording).table.head(100)
    shadow = table["energy_j"].to_numpy() - 0.1 * 9.81 / 240 * recording.states["vz_m_s"][:100] / 2
    assert np.abs(shadow - shadow[0]).max() < 5e-15


@pytest.mark.parametrize("coordinates", ["reduced", "maximal"])
@pytest.mark.parametrize(("body", "damping"), [("cube_small.urdf", 0.3), ("jenga/jenga.urdf", 0.0)])
def test_floating_and_spinning_bodies_conserve_what_they_should(
    recorded: Recorder, body: str, damping: float, coordinates: str
) -> None:
    recording = recorded(
        body=body,
        gravity_m_s2=0.0,
        floor=False,
        coordinates=coordinates,
        mass_kg=0.7,
        velocity_m_s=(1.0, 2.0, 3.0),
        spin_rad_s=(0.0, 0.0, 5.0),
        linear_damping=damping,
        angular_damping=damping,
    )
    conservation = judge(recording).conservation
    inertia_z = recording.engine.inertia_kg_m2[2]
    assert conservation.energy_initial_j == pytest.approx(0.7 * 14 / 2 + inertia_z * 25 / 2)
    assert conservation.energy_max_rel_drift is not None
    assert conservation.angular_momentum_max_rel_drift is not None
    if damping:
        assert conservation.energy_max_rel_drift > 0.1
        assert conservation.angular_momentum_max_rel_drift > 0.1
    else:
        assert conservation.energy_max_rel_drift < 1e-12
        assert conservation.angular_momentum_max_rel_drift < 1e-12


def test_energy_and_momentum_of_a_turned_body_are_those_of_its_principal_axes() -> None:
    """A body rotated by 90° about x that spins about world z spins about its own y axis."""
    half = math.sqrt(0.5)
    sample = Motion(
        position_m=np.array([[0.0, 0.0, 2.0]]),
        orientation=np.array([[half, 0.0, 0.0, half]]),
        velocity_m_s=np.zeros((1, 3)),
        spin_rad_s=np.array([[0.0, 0.0, 3.0]]),
    )
    inertia_kg_m2 = np.array([1.0, 10.0, 100.0])
    sample_mechanics = mechanics_of_part(sample, 1.5, inertia_kg_m2, -9.81)
    assert sample_mechanics.kinetic_angular_j[0] == pytest.approx(10 * 3**2 / 2)
    assert sample_mechanics.angular_momentum_kg_m2_s[0] == pytest.approx([0, 0, 30])
    assert sample_mechanics.potential_j[0] == pytest.approx(1.5 * 9.81 * 2)


def test_what_starts_at_zero_has_no_relative_drift(recorded: Recorder) -> None:
    conservation = judge(recorded(gravity_m_s2=0.0)).conservation
    assert conservation.energy_max_rel_drift is None
    assert conservation.angular_momentum_max_rel_drift is None


# -- rest -----------------------------------------------------------------------------------------


def test_what_slides_or_spins_is_not_at_rest(recorded: Recorder) -> None:
    """Sliding keeps the height, spinning keeps the centre; at rest both pose parts stay."""
    slides = recorded(height_m=0.03, velocity_m_s=(0.5, 0.0, 0.0), friction=0.0, duration_s=1.0)
    spins = recorded(
        body="sphere_small.urdf",
        height_m=0.0301,
        spin_rad_s=(0.0, 0.0, 50.0),
        friction=0.0,
        angular_damping=0.0,
        duration_s=1.0,
    )
    assert judge(slides).rest is None
    assert judge(spins).rest is None


SLOW: dict[str, dict[str, Any]] = {
    "spins": {"body": "sphere_small.urdf", "height_m": 0.0301, "spin_rad_s": (0.0, 0.0, 0.005)},
    "slides": {"height_m": 0.0251, "velocity_m_s": (2e-5, 0.0, 0.0)},
    "is slowed down": {"height_m": 0.0251, "spin_rad_s": (0.0, 0.0, 0.005), "angular_damping": 0.9,
                       "duration_s": 8.0},
}  # fmt: skip
"""Slow motions on a frictionless floor, for 3 s."""


@pytest.mark.parametrize("kind", SLOW)
def test_what_goes_on_slowly_has_no_first_sample_of_its_rest(recorded: Recorder, kind: str) -> None:
    """A slow motion is the same before and after, so a rest sample would depend on the duration."""
    recording = recorded(**{"duration_s": 3.0, "friction": 0.0} | SLOW[kind])
    analysis = judge(recording)
    rest, stops = analysis.rest, kind == "is slowed down"
    assert rest is not None
    assert rest.height_m == recording.states["z_m"][-1]
    assert ("rest" in analysis.table["phase"]) == stops
    assert (rest.settled_step is not None) == stops
    assert ("at rest" in events(analysis)[-1][-1]) == stops


@pytest.mark.long
def test_a_body_rests_only_after_a_tenth_of_a_second(recorded: Recorder) -> None:
    """Recordings of any length end 24 steps of 1/240 s after the settling sample."""
    recording = recorded()
    seen, lasts = recording.seen, {}
    for samples in range(150, 242):
        scenario = replace(recording.scenario, duration_s=(samples - 1) / 240)
        first = HeldSamples(*(between(rows, 0, samples) for rows in (seen.bases, seen.contacts)))
        rest = fall_of(DropCase(scenario, recording.engine, replace(seen, sampled=first))).rest
        if rest is not None:
            lasts[samples] = samples - 1 - rest.settled_step
    assert min(lasts.values()) == 24
    assert 150 not in lasts


def test_a_rod_that_toppled_is_not_measured_against_its_upright_height(
    recorded: Recorder, tmp_path: Path
) -> None:
    rod = tmp_path / "rod.urdf"
    rod.write_text(
        '<robot name="rod"><link name="base"><inertial><mass value="1"/>'
        '<inertia ixx="0.013" ixy="0" ixz="0" iyy="0.013" iyz="0" izz="0.0002"/></inertial>'
        '<collision><geometry><cylinder radius="0.02" length="0.4"/></geometry></collision>'
        "</link></robot>"
    )
    analysis = judge(
        recorded(body=str(rod), height_m=0.5, orientation=(3.0, 0.0, 0.0), duration_s=4.0)
    )
    assert analysis.tumbled_step is not None
    assert analysis.rest is None or (analysis.rest.expected_m, analysis.rest.terms_m) == (
        None,
        None,
    )
    assert "rest-below-expected" not in [finding.code for finding in analysis.findings]

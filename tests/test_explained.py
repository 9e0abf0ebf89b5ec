"""Verification: an analysis explains every sample of a drop, and claims nothing beyond that."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from conftest import Drop, Recorder, judge, some
from drop_physics.drop.results import DropAnalysis
from drop_physics.drop.story import drop_analysis_of
from drop_physics.recording.reader import Recording
from drop_physics.trace.history import HeldSamples
from drop_physics.trace.states import BODY
from engine import ROUNDS_ONCE, shape, urdf_of

TUMBLING: dict[str, Any] = {"restitution": 0.8, "duration_s": 3.0}


def codes(analysis: DropAnalysis) -> set[str]:
    return {finding.code for finding in analysis.findings}


def test_a_box_is_explained_through_its_tumbling(recorded: Recorder) -> None:
    analysis = judge(recorded(**TUMBLING))
    assert analysis.tumbled_step is not None
    explained = analysis.explained
    assert explained.samples == explained.of == 721
    assert (explained.until_s, explained.why) == (3.0, None)
    assert 0 < explained.remainder < 1e-9
    assert analysis.segments["contact"] > 100
    ends = [flight.last_step for flight in analysis.flights]
    assert max(ends) > analysis.tumbled_step + 20
    # Contact and flight alternate from the release to the end.
    for phase in analysis.bodies[0].contacts:
        begins = [flight for flight in analysis.flights if flight.last_step == phase.first_step - 1]
        assert len(begins) == 1
    assert "law-mismatch" not in codes(analysis)


@pytest.mark.parametrize("coordinates", ["reduced", "maximal"])
def test_a_thrown_and_spinning_body_is_explained(recorded: Recorder, coordinates: str) -> None:
    how: Any = {"spin_rad_s": (3.0, -8.0, 5.0), "velocity_m_s": (2.0, 1.0, 3.0), **TUMBLING}
    analysis = judge(recorded(coordinates=coordinates, **how))
    assert analysis.explained.why is None
    assert analysis.segments["flight"] > 200
    assert analysis.segments["contact"] > 5


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"coordinates": "maximal", "linear_damping": 0.2, "velocity_m_s": (1.0, 0.0, 2.0)},
        {"velocity_m_s": (3.0, -2.0, 4.0), "spin_rad_s": (1.0, 2.0, 3.0)},
        {"substeps": 3, "velocity_m_s": (0.0, 0.0, -1.0)},
    ],
)
def test_the_first_flight_is_the_fall(recorded: Recorder, how: Any) -> None:
    recording = recorded(floor=False, **how)
    analysis = judge(recording, at_s=(1.0,))
    (flight,), (moment,) = analysis.flights, analysis.at
    assert (flight.first_step, flight.last_step, flight.end_s) == (0, 240, 1.0)
    assert flight.terms_m is not None
    assert moment.terms_m is not None
    assert flight.error_m[2] == moment.error_m
    for name, term in asdict(moment.terms_m).items():
        assert getattr(flight.terms_m, name)[2] == term, name


def test_the_fall_of_the_standard_drop_ends_where_the_floor_pushes(recorded: Recorder) -> None:
    recording = recorded()
    analysis = judge(recording)
    (fall,) = analysis.flights
    assert (fall.first_step, fall.last_step) == (0, 108)
    time_s, height_m = 108 / 240, recording.states["z_m"][108]
    assert fall.error_m == pytest.approx((0, 0, height_m - (1 - 9.81 * time_s**2 / 2)), abs=1e-15)
    counts = {"flight": 108, "contact": 132, "set": 1}
    assert analysis.segments == dict.fromkeys(analysis.segments, 0) | counts


def test_what_contact_gave_is_momentum_and_energy(recorded: Recorder) -> None:
    recording = recorded(linear_damping=0.0, angular_damping=0.0, **TUMBLING)
    analysis = judge(recording)
    mass_kg, weight_n = analysis.engine.mass_kg, analysis.engine.mass_kg * 9.81
    velocity_m_s = recording.states.select("vx_m_s", "vy_m_s", "vz_m_s").to_numpy()
    dt = analysis.scenario["timestep_s"]
    for phase in analysis.bodies[0].contacts:
        before, after = velocity_m_s[phase.first_step - 1], velocity_m_s[phase.last_step]
        steps = phase.last_step - phase.first_step + 1
        impulse = mass_kg * (after - before) + np.array((0, 0, weight_n * dt * steps))
        assert phase.impulse_n_s == pytest.approx(impulse.tolist(), abs=1e-13)
        assert phase.largest_force_n * dt * steps >= np.linalg.norm(phase.impulse_n_s) * (1 - 1e-9)
    # Whatever the energy lost that the integrator did not take, contact took.
    energy = judge(recording).bodies[0].energy
    assert energy is not None
    assert energy.by_cause_j["contacts"] == pytest.approx(analysis.contact_j, rel=1e-6)


# -- altered recordings ----------------------------------------------------------------------------


def altered(recording: Recording, step: int, column: str, by: float) -> DropAnalysis:
    there = pl.col("step") == step
    states = recording.states.with_columns(
        pl.when(there).then(pl.col(column) + by).otherwise(pl.col(column)).alias(column)
    )
    return judge(recording, states)


@pytest.mark.parametrize(
    ("step", "column"),
    some(
        [
            (0, "x_m"),
            (0, "wy_rad_s"),
            (60, "qy"),
            (109, "vz_m_s"),
            (400, "vx_m_s"),
            (500, "wy_rad_s"),
            (720, "x_m"),
        ],
        2,
    ),
)
def test_an_altered_sample_ends_what_is_explained(
    recorded: Recorder, step: int, column: str
) -> None:
    analysis = altered(recorded(**TUMBLING), step, column, 1e-9)
    until_s = None if step == 0 else pytest.approx((step - 1) / 240)
    assert analysis.explained.until_s == until_s
    assert f"at sample {step} " in (analysis.explained.why or "")
    # The sample itself, and at most the next one, which is stepped from it.
    assert 1 <= analysis.segments["unexplained"] <= 2
    assert "law-mismatch" in codes(analysis)


def test_where_next_to_nothing_acts_the_rounding_of_the_momentum_is_no_remainder(
    recorded: Recorder,
) -> None:
    thrown: Any = {"velocity_m_s": (-0.4, -4.2, 3.1), "orientation": (30.0, 20.0, 10.0)}
    recording = recorded(gravity_m_s2=0.0, linear_damping=1e-12, duration_s=0.1, **thrown)
    assert judge(recording).explained.why is None
    assert altered(recording, 5, "vy_m_s", 1e-13).explained.until_s == pytest.approx(4 / 240)


def test_an_altered_force_ends_what_is_explained(recorded: Recorder) -> None:
    recording = recorded(**TUMBLING)
    forced = recording.contacts.filter(pl.col("normal_force_n") > 0)["step"].to_list()
    step = forced[len(forced) // 2]
    force = pl.col("normal_force_n")
    contacts = recording.contacts.with_columns(
        pl.when(pl.col("step") == step)
        .then(force * (1 + 1e-8))
        .otherwise(force)
        .alias("normal_force_n")
    )
    analysis = judge(recording, contacts=contacts)
    assert analysis.explained.until_s == pytest.approx((step - 1) / 240)
    assert analysis.segments["unexplained"] == 1


def test_a_release_that_is_not_the_scenarios_is_unexplained(recorded: Recorder) -> None:
    analysis = altered(recorded(floor=False), 0, "z_m", -(2.0**-53))  # the last bit below 1
    assert analysis.explained.until_s == (None if ROUNDS_ONCE else 1.0)


def test_what_is_recorded_after_the_last_state_is_no_sample(recorded: Recorder) -> None:
    """Such a recording was cut off between contacts and states."""

    class Ahead(HeldSamples):
        """Samples with a claimed last step that was never sampled."""

        @property
        def last(self) -> int:
            """Return a last step that was never sampled."""
            return 20_000

    recording = recorded()
    sampled = Ahead(recording.seen.bases, recording.seen.contacts)
    seen = replace(recording.seen, sampled=sampled)
    analysis = drop_analysis_of(recording.scenario, recording.engine, seen)
    assert analysis.table.equals(judge(recording).table)
    assert analysis.explained == judge(recording).explained


# -- what is not covered ---------------------------------------------------------------------------


def test_a_robot_is_explained_by_the_sum(recorded: Recorder) -> None:
    """The free-flight rule applies to a single rigid body only; a robot needs the sum."""
    recording = recorded(body="r2d2.urdf", duration_s=0.1)
    analysis = judge(recording)
    assert analysis.explained.samples == analysis.explained.of == 25
    assert analysis.explained.remainder < 1e-9
    assert analysis.segments["unexplained"] == 0
    assert analysis.flights == []
    assert "15 joints" in analysis.coverage.why


def test_substeps_are_explained_in_the_air_alone(recorded: Recorder) -> None:
    analysis = judge(recorded(substeps=4, restitution=0.8, duration_s=2.0))
    assert analysis.segments["contact"] == 0
    assert "substeps" in (analysis.explained.why or "")
    assert analysis.explained.until_s == pytest.approx(0.45, abs=0.02)
    assert len(analysis.flights) > 2  # after a bounce a flight begins again
    assert "law-mismatch" not in codes(analysis)


def test_rolling_friction_is_a_term_of_the_sum(recorded: Recorder, tmp_path: Path) -> None:
    body = urdf_of(
        tmp_path, shape('<sphere radius="0.05"/>'), contact='<rolling_friction value="0.05"/>'
    )
    analysis = judge(recorded(body=body, velocity_m_s=(2.0, 0.0, 0.0), height_m=0.2))
    assert analysis.explained.why is None
    (energy,) = [body.energy for body in analysis.bodies if body.id == BODY]
    assert energy is not None
    assert energy.by_cause_j["rolling"] < 0
    assert analysis.segments["flight"] > 20
    assert "law-mismatch" not in codes(analysis)


def test_the_first_push_of_a_turned_btrigidbody_is_reported(recorded: Recorder) -> None:
    """A slab that is loaded flat and released on its edge is pushed as if it lay flat."""
    how: Any = {"body": "jenga/jenga.urdf", "orientation": (20.0, 50.0, 10.0), "height_m": 0.02}
    analysis = judge(recorded(coordinates="maximal", **how))
    assert analysis.explained.until_s == 0
    assert "add up" in (analysis.explained.why or "")
    assert analysis.segments["unexplained"] == 1
    assert "law-mismatch" not in codes(analysis)
    assert judge(recorded(coordinates="reduced", **how)).explained.why is None


def test_a_recording_without_a_step_is_still(recorded: Recorder) -> None:
    recording = recorded(stepped=False, height_m=2.0)
    analysis = judge(recording)
    assert analysis.segments["still"] == analysis.explained.samples == 241
    assert analysis.flights == []
    analysis = altered(recording, 100, "qz", 1e-12)
    assert analysis.explained.until_s == pytest.approx(99 / 240)
    assert analysis.segments["unexplained"] == 1


def test_a_flight_whose_velocity_is_held_has_an_error_and_no_terms(recorded: Recorder) -> None:
    analysis = judge(recorded(velocity_m_s=(0.0, 0.0, 150.0), floor=False))
    (flight,) = analysis.flights
    assert flight.terms_m is None
    assert flight.error_m[2] < -40  # it covers at most 100 of 150 m in a second
    assert analysis.explained.why is None  # the limit is part of Bullet's law


# -- on the terminal -------------------------------------------------------------------------------


def test_the_terminal_shows_it_in_a_few_lines(drop: Drop) -> None:
    drop("simulate", "--out", "b.rrd", "--restitution", "0.8", "--duration", "3", "--no-camera")
    shown = drop("analyze", "b.rrd", "--verbose").stdout
    lines = shown.splitlines()
    assert max(map(len, lines)) <= 80
    begin = next(n for n, line in enumerate(lines) if line.startswith("Explained"))
    assert "all 721 samples" in lines[begin]
    begin = next(n for n, line in enumerate(lines) if line.startswith("Flights")) - 1
    flights = lines[begin + 1 : begin + 10]
    assert flights[0].startswith("Flights")
    assert flights[2].split() == ["0.0000", "0.4500", "+0.0000", "+0.0000", "+9.4434", "box"]
    assert flights[8].startswith("and ")
    contacts = lines[begin + 11 : begin + 19]
    assert contacts[0].startswith("Contacts")
    assert contacts[2].split()[2:] == ["0.7225", "173.4", "-0.485", "on", "floor"]
    ends = {line.rindex("  box") for line in flights[2:8]}
    assert ends == {len(flights[1])}
    assert {line.rindex("  on floor") for line in contacts[2:8]} == {len(contacts[1])}

"""The verdict on a fall: everything that its samples tell, in one typed result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.budget.conservation import Mechanics, max_relative_drift, mechanics
from pipeline.budget.decomposition import Decomposition, decompose
from pipeline.budget.energy import ledger
from pipeline.budget.findings import Evidence, findings
from pipeline.budget.landing import (
    contact_law_path,
    find_bounces,
    find_contact,
    find_impact,
    find_rest,
)
from pipeline.budget.mismatch import coverage_of, find_mismatch
from pipeline.budget.moment import DEFAULT_AT_S
from pipeline.budget.phases import Phases, phases
from pipeline.budget.results import Airborne, Analysis, Conservation, Coverage, Moment, Terms
from pipeline.budget.samples import Samples, samples_of
from pipeline.errors import ScenarioError
from pipeline.physics import theory
from pipeline.physics.bullet_law import fall_of
from pipeline.physics.report import EngineReport
from pipeline.physics.theory import Fall
from pipeline.scenario import Scenario

Float64 = NDArray[np.float64]


def analysis_of(
    scenario: Scenario,
    engine: EngineReport,
    states: pl.DataFrame,
    *,
    at_s: Sequence[float] = (),
) -> Analysis:
    """Analyze the samples of a fall.

    Parameters
    ----------
    scenario
        What was dropped, and how.
    engine
        What the engine reported of the body: mass, inertia, joints, shape, rest height.
    states
        One row per sample from the release on: `step`, and the columns of the recording's state.
    at_s
        Times to take apart [s]; without any, 0.3 s where that is in the air.

    Raises
    ------
    ScenarioError
        If a time lies outside the recording.
    """
    samples, reported = samples_of(states), engine.as_properties()
    fall, timestep_s = fall_of(scenario), scenario.timestep_s
    speed_m_s = np.linalg.norm(samples.velocity_m_s, axis=1)
    found = phases(samples.height_m, speed_m_s, samples.contact_points)
    mismatch = find_mismatch(scenario, reported, fall, samples, airborne=found.airborne)
    coverage = coverage_of(scenario, reported, found, mismatch)
    parts = decompose(fall, samples.height_m[: coverage.samples], timestep_s=timestep_s)
    energies = mechanics(
        samples,
        mass_kg=engine.mass_kg,
        inertia_kg_m2=np.array(engine.inertia_kg_m2),
        gravity_m_s2=fall.gravity_m_s2,
    )
    table = _table(scenario, reported, fall, found, samples, parts, energies)
    at = [_moment(table, step) for step in _steps_at(at_s, scenario, coverage)]

    law = contact_law_path(scenario, reported, fall, steps=found.samples - 1)
    law_m = None if law is None else law[0]
    impact = find_impact(scenario, reported, fall, found, samples)
    bounces = find_bounces(scenario, reported, fall, samples)
    rest = find_rest(scenario, reported, found, samples, law_m)
    evidence = Evidence(
        scenario=scenario,
        engine=reported,
        fall=fall,
        time_s=table["time_s"].to_numpy(),
        samples=samples,
        phases=found,
        mismatch=mismatch,
        moment=at[0] if at else None,
        impact=impact,
        bounces=bounces,
        rest=rest,
    )
    return Analysis(
        scenario=asdict(scenario),
        engine=reported,
        at=at,
        coverage=coverage,
        airborne=_airborne(parts),
        impact=impact,
        contact=find_contact(found, samples.height_m, law_m),
        bounces=bounces,
        rest=rest,
        conservation=_conservation(energies, samples.contact_points == 0),
        energy=ledger(
            energies,
            samples.velocity_m_s,
            fall,
            airborne=found.airborne,
            timestep_s=timestep_s,
            mass_kg=engine.mass_kg,
            stepped=scenario.stepped,
        ),
        findings=findings(evidence),
        table=table,
    )


def _table(
    scenario: Scenario,
    engine: Mapping[str, Any],
    fall: Fall,
    found: Phases,
    samples: Samples,
    parts: Decomposition,
    energies: Mechanics,
) -> pl.DataFrame:
    """Return one row per sample; error terms are null where the law of the air does not hold."""
    time_s = np.arange(found.samples, dtype=np.float64) * scenario.timestep_s
    # Theory knows no floor. After the first contact it is held at the rest height.
    lowest_m = np.full(found.samples, -math.inf)
    if scenario.floor:
        lowest_m[found.airborne :] = engine["rest_height_m"]
    free_fall_m = np.maximum(theory.free_fall_height(fall, time_s), lowest_m)

    def explained(values: Float64) -> pl.Series:
        return pl.Series(values, dtype=pl.Float64).extend_constant(
            None, found.samples - len(values)
        )

    return pl.DataFrame(
        {
            "step": np.arange(found.samples),
            "time_s": time_s,
            "phase": found.column(),
            "simulated_m": samples.height_m,
            "free_fall_m": free_fall_m,
            "damped_fall_m": np.maximum(theory.damped_fall_height(fall, time_s), lowest_m),
            "error_m": samples.height_m - free_fall_m,
            "timestep_m": explained(parts.timestep_m),
            "damping_m": explained(parts.damping_m),
            "interaction_m": explained(parts.interaction_m),
            "rounding_m": explained(parts.rounding_m),
            "kinetic_linear_j": energies.kinetic_linear_j,
            "kinetic_angular_j": energies.kinetic_angular_j,
            "potential_j": energies.potential_j,
            "energy_j": energies.total_j,
        }
    )


def _steps_at(at_s: Sequence[float], scenario: Scenario, coverage: Coverage) -> list[int]:
    """Return the samples nearest to the times asked for, or the default one."""
    last, covered = coverage.of - 1, coverage.samples
    end_s = last * scenario.timestep_s
    for time_s in at_s:
        if not 0 <= time_s <= end_s * (1 + 1e-12):
            raise ScenarioError(
                f"--at must lie within the recording, 0 to {end_s:g} s, got {time_s:g}"
            )
    if at_s:
        return [min(last, round(time_s / scenario.timestep_s)) for time_s in at_s]
    if covered < 2:  # the release alone tells nothing
        return []
    standard = round(DEFAULT_AT_S / scenario.timestep_s)
    return [standard if standard < covered else (covered - 1) // 2]


def _moment(table: pl.DataFrame, step: int) -> Moment:
    row = table.row(step, named=True)
    names = ("timestep", "damping", "interaction", "rounding")
    explained = row["timestep_m"] is not None
    return Moment(
        time_s=row["time_s"],
        step=step,
        phase=row["phase"],
        simulated_m=row["simulated_m"],
        free_fall_m=row["free_fall_m"],
        error_m=row["error_m"],
        terms_m=Terms(**{name: row[f"{name}_m"] for name in names}) if explained else None,
    )


def _airborne(parts: Decomposition) -> Airborne:
    if not len(parts.total_m):
        return Airborne(0, None, None, None)
    return Airborne(
        samples=len(parts.total_m),
        max_abs_error_m=float(np.abs(parts.total_m).max()),
        rms_error_m=float(np.sqrt(np.mean(parts.total_m**2))),
        max_abs_rounding_m=float(np.abs(parts.rounding_m).max()),
    )


def _conservation(energies: Mechanics, without_contact: NDArray[np.bool_]) -> Conservation:
    return Conservation(
        energy_initial_j=float(energies.total_j[0]),
        energy_max_rel_drift=max_relative_drift(energies.total_j[without_contact]),
        angular_momentum_max_rel_drift=max_relative_drift(
            energies.angular_momentum_kg_m2_s[without_contact]
        ),
    )

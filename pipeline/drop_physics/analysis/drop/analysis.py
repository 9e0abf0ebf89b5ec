"""The analysis of a fall: everything that its samples show, in one typed result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.analysis.drop.case import Case, case_of
from drop_physics.analysis.drop.energy import contact_energy_j
from drop_physics.analysis.drop.evidence import Evidence
from drop_physics.analysis.drop.findings import findings
from drop_physics.analysis.drop.landing import (
    find_bounces,
    find_contact,
    find_impact,
    find_landing,
    find_rest,
    law_path,
)
from drop_physics.analysis.drop.mismatch import (
    clamped_step,
    contact_phases,
    coverage_of,
    explained_of,
    find_mismatch,
    unseen_contact,
)
from drop_physics.analysis.drop.one_sample import DEFAULT_AT_S
from drop_physics.analysis.drop.phases import Phases, phases_of, touching
from drop_physics.analysis.drop.posture import tumbled_step, tumbles
from drop_physics.analysis.drop.results import (
    Airborne,
    Conservation,
    Coverage,
    FallAnalysis,
    Moment,
    Terms,
)
from drop_physics.analysis.explained.judged import SEGMENTS
from drop_physics.analysis.general.decomposition import TERMS, Decomposition
from drop_physics.analysis.general.flights import decomposed
from drop_physics.analysis.general.mechanics import Mechanics, max_relative_drift, mechanics
from drop_physics.errors import ScenarioError
from drop_physics.report import EngineReport
from drop_physics.scenario import Scenario

Float64 = NDArray[np.float64]


def fall_analysis_of(
    scenario: Scenario,
    engine: EngineReport,
    states: pl.DataFrame,
    contacts: pl.DataFrame,
    *,
    at_s: Sequence[float] = (),
) -> FallAnalysis:
    """Analyze the samples of a fall.

    Parameters
    ----------
    scenario
        What was dropped, and how.
    engine
        What the engine reported about the body and the floor.
    states
        The recording's table: one row per sample and part, from the release on.
    contacts
        The recording's table: one row per contact point.
    at_s
        Times at which to break down the error [s]; without any, 0.3 s where that is in free flight.

    Raises
    ------
    ScenarioError
        If a time lies outside the recording.
    """
    case = case_of(scenario, engine, states, contacts)
    phases = phases_of(case)
    mismatch = find_mismatch(case, phases)
    unseen = unseen_contact(case, mismatch)
    if unseen is not None:
        phases, mismatch = replace(phases, contact_step=unseen), None
    clamped = clamped_step(case, phases)
    coverage = coverage_of(case, phases, mismatch, clamped)
    flights, parts = decomposed(
        case.samples, case.law, case.segments, release=case.fall, at_least=coverage.samples
    )
    parts = parts.first(coverage.samples)
    energies = mechanics(case.engine, case.samples)
    table = _table(case, phases, parts, energies)
    at = [_moment(table, step) for step in _steps_at(at_s, scenario, coverage)]

    tumbled = tumbled_step(case, touching(case.samples))
    law = law_path(case)
    landing = find_landing(case)
    impact = find_impact(case, phases, landing)
    bounces = find_bounces(case, tumbled)
    rest = find_rest(case, phases, tumbled, law)
    evidence = Evidence(
        case=case,
        phases=phases,
        mismatch=mismatch,
        clamped_step=clamped,
        moment=at[0] if at else None,
        landing=landing,
        impact=impact,
        tumbled_step=tumbled,
        bounces=bounces,
        rest=rest,
        law=law,
    )
    counts = dict[str, int](case.segments.counts().items())
    return FallAnalysis(
        scenario=asdict(scenario),
        engine=engine,
        at=at,
        coverage=coverage,
        airborne=_airborne(parts),
        landing=landing,
        impact=impact,
        tumbled_step=tumbled,
        tumbles=tumbled is not None and tumbles(case, tumbled),
        contact=find_contact(case, phases, tumbled, law),
        bounces=bounces,
        rest=rest,
        conservation=_conservation(case, energies, phases.airborne),
        contact_j=contact_energy_j(case, energies, airborne=phases.airborne),
        segments={kind: counts.get(kind, 0) for kind in SEGMENTS},
        flights=flights,
        explained=explained_of(case, mismatch),
        contact_phases=contact_phases(case),
        findings=findings(evidence),
        table=table,
    )


def _table(case: Case, phases: Phases, parts: Decomposition, energies: Mechanics) -> pl.DataFrame:
    """Return one row per sample; error terms are null where free flight is not covered."""

    def explained(values: Float64) -> pl.Series:
        return pl.Series(values, dtype=pl.Float64).extend_constant(
            None, phases.samples - len(values)
        )

    height_m = case.samples.height_m
    return pl.DataFrame(
        {
            "step": np.arange(phases.samples),
            "time_s": case.time_s,
            "phase": phases.column(),
            "simulated_m": height_m,
            "free_fall_m": case.free_fall_m,
            "damped_fall_m": case.damped_fall_m,
            "error_m": height_m - case.free_fall_m,
            **{f"{name}_m": explained(getattr(parts, f"{name}_m")[:, 2]) for name in TERMS},
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
                "--at must lie within the recording, 0 to {end:g} s, got {time:g}",
                end=end_s,
                time=time_s,
            )
    if at_s:
        return [min(last, round(time_s / scenario.timestep_s)) for time_s in at_s]
    if covered < 2:  # the release alone has no error
        return []
    standard = round(DEFAULT_AT_S / scenario.timestep_s)
    return [standard if standard < covered else (covered - 1) // 2]


def _moment(table: pl.DataFrame, step: int) -> Moment:
    row = table.row(step, named=True)
    explained = row["timestep_m"] is not None
    return Moment(
        time_s=row["time_s"],
        step=step,
        phase=row["phase"],
        simulated_m=row["simulated_m"],
        free_fall_m=row["free_fall_m"],
        error_m=row["error_m"],
        terms_m=Terms(**{name: row[f"{name}_m"] for name in TERMS}) if explained else None,
    )


def _airborne(parts: Decomposition) -> Airborne:
    error_m = parts.total_m[:, 2]
    if not len(error_m):
        return Airborne(0, None, None, None)
    return Airborne(
        samples=len(error_m),
        max_abs_error_m=float(np.abs(error_m).max()),
        rms_error_m=float(np.sqrt(np.mean(error_m**2))),
        max_abs_rounding_m=float(np.abs(parts.rounding_m[:, 2]).max()),
    )


def _conservation(case: Case, energies: Mechanics, airborne: int) -> Conservation:
    if case.substeps > 1 and not case.is_rigid:  # when it first touched is not known
        return Conservation(float(energies.total_j[0]), None, None)
    free = slice(max(airborne, 1))
    return Conservation(
        energy_initial_j=float(energies.total_j[0]),
        energy_max_rel_drift=max_relative_drift(energies.total_j[free]),
        angular_momentum_max_rel_drift=max_relative_drift(energies.angular_momentum_kg_m2_s[free]),
    )

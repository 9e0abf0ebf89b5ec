"""The analysis of a fall: everything that its samples show, in one typed result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.analysis.decomposition import TERMS, Decomposition, decompose
from drop_physics.analysis.drop.air import Air, coverage_of
from drop_physics.analysis.drop.case import Case, case_of
from drop_physics.analysis.drop.energy import contact_energy_j
from drop_physics.analysis.drop.landing import (
    find_bounces,
    find_contact,
    find_impact,
    find_landing,
    find_rest,
    law_path,
)
from drop_physics.analysis.drop.mechanics import max_relative_drift, mechanics
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
from drop_physics.analysis.drop.samples import blocks
from drop_physics.analysis.rows import SHOWN_PER_S
from drop_physics.errors import ScenarioError
from drop_physics.report import EngineReport
from drop_physics.scenario import Scenario

Float64 = NDArray[np.float64]

DUE = (pl.col("time_s") * SHOWN_PER_S + 1e-9).floor()
SHOWN = (
    (DUE.shift(1, fill_value=-1) != DUE)
    | (pl.col("phase") != pl.col("phase").shift(1, fill_value=""))
    | (pl.col("timestep_m").is_null() != pl.col("timestep_m").shift(-1).is_null())
)
"""The rows that curves show: so many a second, and where something changes."""


@dataclass(frozen=True)
class Fall:
    """A fall: what it is about, what was found, and when it touched."""

    case: Case
    phases: Phases
    air: Air
    analysis: FallAnalysis


def fall_of(case: Case, *, at_s: Sequence[float] = (), whole: bool = True) -> Fall:
    """Analyze the samples of a fall.

    Parameters
    ----------
    case
        What was dropped, how, and its samples.
    at_s
        Times at which to break down the error [s]; without any, 0.3 s where that is in free flight.
    whole
        Whether the table has all samples, or those that are shown.

    Raises
    ------
    ScenarioError
        If a time lies outside the recording.
    """
    phases = phases_of(case)
    air = Air(case, phases)
    if air.touched_step is not None:
        phases = replace(phases, contact_step=air.touched_step)
        air = Air(case, phases)
    coverage = coverage_of(air)
    parts = decompose(case.law, case.fall, case.samples.position_m[: coverage.samples])
    steps = _steps_at(at_s, case.scenario, coverage)
    table = _table(case, phases, parts, None if whole else [0, *steps, phases.samples - 1])
    tumbled = tumbled_step(case, touching(case.samples))
    law, landing = law_path(case), find_landing(case)
    analysis = FallAnalysis(
        scenario=asdict(case.scenario),
        engine=case.engine,
        at=[_moment(table, step) for step in steps],
        coverage=coverage,
        airborne=_airborne(parts),
        landing=landing,
        impact=find_impact(case, phases, landing),
        tumbled_step=tumbled,
        tumbles=tumbled is not None and tumbles(case, tumbled),
        contact=find_contact(case, phases, tumbled, law),
        bounces=find_bounces(case, tumbled),
        rest=find_rest(case, phases, tumbled, law),
        conservation=_conservation(case, phases.airborne),
        contact_j=contact_energy_j(case, airborne=phases.airborne),
        table=table,
    )
    return Fall(case, phases, air, analysis)


def fall_analysis_of(
    scenario: Scenario,
    engine: EngineReport,
    states: pl.DataFrame,
    contacts: pl.DataFrame,
    *,
    at_s: Sequence[float] = (),
) -> FallAnalysis:
    """Return the analysis of a fall from the tables of its recording: see `case_of`, `fall_of`."""
    return fall_of(case_of(scenario, engine, states, contacts), at_s=at_s).analysis


def _table(
    case: Case, phases: Phases, parts: Decomposition, kept: Sequence[int] | None
) -> pl.DataFrame:
    """Return one row per sample; error terms are null where free flight is not covered.

    `kept`: steps to keep, besides those that are shown; None for all.
    """
    parts_of_it = (_rows(case, rows, phases, parts) for rows in blocks(phases.samples))
    if kept is not None:
        shown = SHOWN | pl.col("step").is_in(kept)
        parts_of_it = (rows.filter(shown) for rows in parts_of_it)
    return pl.concat(parts_of_it)


def _rows(case: Case, rows: slice, phases: Phases, parts: Decomposition) -> pl.DataFrame:
    """Return some rows of the table."""
    steps, height_m, time_s = np.r_[rows], case.samples.height_m[rows], case.time_s[rows]
    energies, free_fall_m = mechanics(case.engine, case.samples, rows), case.free_fall_m(time_s)

    def explained(values: Float64) -> pl.Series:
        held = values[rows]
        return pl.Series(held, dtype=pl.Float64).extend_constant(None, len(height_m) - len(held))

    return pl.DataFrame(
        {
            "step": steps,
            "time_s": time_s,
            "phase": phases.of(steps),
            "simulated_m": height_m,
            "free_fall_m": free_fall_m,
            "damped_fall_m": case.damped_fall_m(time_s),
            "error_m": height_m - free_fall_m,
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
    row = table.row(by_predicate=pl.col("step") == step, named=True)
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


def _conservation(case: Case, airborne: int) -> Conservation:
    energies = mechanics(case.engine, case.samples, slice(max(airborne, 1)))
    initial_j = float(energies.total_j[0])
    if case.substeps > 1 and not case.is_rigid:  # when it first touched is not known
        return Conservation(initial_j, None, None)
    return Conservation(
        energy_initial_j=initial_j,
        energy_max_rel_drift=max_relative_drift(energies.total_j),
        angular_momentum_max_rel_drift=max_relative_drift(energies.angular_momentum_kg_m2_s),
    )

"""Facts of each run of a sweep over engines beyond its error: impact, contact, rest, cost, drift.

Each scenario is dropped once more, in memory, because its row has only one sample.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import polars as pl

from drop_physics.arrays import Float64
from drop_physics.drop.analysis import fall_of
from drop_physics.drop.convergence import ROUNDED, observed_orders
from drop_physics.drop.results import Rest
from drop_physics.engines.worlds import Worlds
from drop_physics.messages import Message
from drop_physics.physics.base import ROUNDING
from drop_physics.physics.laws.lookup import law_for
from drop_physics.scenario import Engine, Scenario
from drop_physics.stages.recorded import BATCH, case_of
from drop_physics.sweeping.plan import Plan

MOST_RUNS = 30
"""Most runs of a sweep over engines that are dropped again to compare the engines."""
TIMED_STEPS, TIMED_FALLS = 1000, 3
"""Most steps that are timed, and how many times: the fastest counts."""


@dataclass(frozen=True)
class EngineRun:
    """One scenario in one engine."""

    run: int
    """Its number in the sweep."""
    engine: Engine
    """The engine."""
    timestep_s: float
    """Its timestep."""
    impact_s: float | None
    """Time at which its centre reached the rest height; None if that is not known."""
    penetration_m: float | None
    """Its deepest penetration."""
    rest_error_m: float | None
    """Its height at rest, minus that at which it touches the floor; None if it keeps moving."""
    rest_cause: str | None
    """Cause of that error; None without a proven one."""
    contact_j: float | None
    """The energy that contact added to it, or took if negative."""
    energy_drift: float | None
    """Largest relative change of the energy before the first contact."""
    angular_momentum_drift: float | None
    """The same for the angular momentum; None where there is none."""
    step_us: float
    """Time per step on this machine [µs], without reading states."""
    order: float | None = None
    """The power of the timestep with which the drift of the angular momentum has shrunk since the
    next longer timestep of the same scenario, in the same engine; None if there is none."""


@dataclass(frozen=True)
class EngineTrajectory:
    """The trajectory of one such run, to be plotted."""

    run: EngineRun
    height_m: Float64
    """The height in all samples, shape (n,)."""
    floor_height_m: float | None
    """The height at which it touches the floor; None without a floor."""
    lost: float
    """Share of the angular momentum that rounding may take, infinite where damping takes some."""


def engine_falls(plan: Plan, results: pl.LazyFrame) -> list[EngineTrajectory]:
    """Return the runs of a sweep over engines that did not fail, dropped once more."""
    failed = set(results.filter(pl.col("error").is_not_null()).select("run").collect()["run"])
    with Worlds() as worlds:
        falls = [
            _dropped(worlds, run, Scenario(**plan.values(run)))
            for run in range(plan.runs)
            if run not in failed
        ]
    return [replace(fall, run=replace(fall.run, order=_order(plan, fall, falls))) for fall in falls]


def _order(plan: Plan, fall: EngineTrajectory, falls: list[EngineTrajectory]) -> float | None:
    """Return the order of a run's drift, against the next longer timestep of its scenario."""

    def fixed(each: EngineTrajectory) -> dict[str, Any]:
        values = plan.values(each.run.run)
        return {name: value for name, value in values.items() if name != "timestep_s"}

    timestep_s = fall.run.timestep_s
    longer = [
        each for each in falls if each.run.timestep_s > timestep_s and fixed(each) == fixed(fall)
    ]
    if not longer:
        return None
    before = min(longer, key=lambda each: each.run.timestep_s)
    drifts = [each.run.angular_momentum_drift or 0.0 for each in (before, fall)]
    # Neither rounding nor what damping takes has an order.
    if max(fall.lost, before.lost) > ROUNDED * min(drifts):
        return None
    (order,) = observed_orders([before.run.timestep_s, timestep_s], drifts)
    return order


def _dropped(worlds: Worlds, run: int, scenario: Scenario) -> EngineTrajectory:
    world = worlds.world_of(scenario)
    analysis = fall_of(case_of(world, world.samples(BATCH)))
    impact, rest = analysis.impact, analysis.rest
    of_engine = EngineRun(
        run=run,
        engine=scenario.engine,
        timestep_s=scenario.timestep_s,
        impact_s=None if impact is None else impact.time_simulated_s,
        penetration_m=None if impact is None else impact.penetration_m,
        rest_error_m=None if rest is None else rest.error_m,
        rest_cause=None if rest is None else _cause(rest),
        contact_j=None if impact is None else analysis.contact_j,
        energy_drift=analysis.conservation.energy_max_rel_drift,
        angular_momentum_drift=analysis.conservation.angular_momentum_max_rel_drift,
        step_us=min(_timed(worlds, scenario)),
    )
    floor_m = analysis.engine.rest_height_m if scenario.floor else None
    law = law_for(scenario, analysis.engine)
    damped = getattr(law, "angular_damping", 0.0) != 0
    lost = math.inf if damped else ROUNDING * math.sqrt(scenario.steps)
    return EngineTrajectory(of_engine, analysis.table["simulated_m"].to_numpy(), floor_m, lost)


def _cause(rest: Rest) -> str | None:
    if rest.terms_m is not None:
        return Message("slop, solver")
    return None if rest.sinks_m is None else Message("soft contact")


def _timed(worlds: Worlds, scenario: Scenario) -> Iterator[float]:
    """Yield how long a step takes [µs], measured repeatedly."""
    steps = min(scenario.steps, TIMED_STEPS)
    for _ in range(TIMED_FALLS):
        world = worlds.world_of(scenario)
        began = time.perf_counter()
        world.skip(steps)
        yield (time.perf_counter() - began) / steps * 1e6

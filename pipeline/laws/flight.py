"""The flight that Bullet's law makes of a scenario: the one place that knows which law that is."""

from __future__ import annotations

import math
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.laws.bullet_air import (
    MAX_COORDINATE_VELOCITY_M_S,
    airborne,
    effective_damping,
    fall_of,
)
from pipeline.laws.bullet_spin import Tumbling, spin_airborne, spinning
from pipeline.report import EngineReport
from pipeline.scenario import Scenario

Float64 = NDArray[np.float64]

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class Flight(NamedTuple):
    """A body before each step and after the last, in world axes; rows of shape (steps + 1, ...)."""

    position_m: Float64
    velocity_m_s: Float64
    spin_rad_s: Float64
    orientation_xyzw: Float64
    clamped: int | None
    """The first sample that the limit of ±100 m/s or rad/s acted on; None where it never does."""


def law_path(scenario: Scenario, report: EngineReport, steps: int) -> Flight:
    """Return the state at samples 0 to `steps` of one rigid body that meets nothing.

    PyBullet's, bit for bit where an operation rounds once (and, where a body spins, where sin and
    cos are the same C library's); orientations up to sign.
    """
    how: dict[str, Any] = {
        "timestep_s": scenario.timestep_s,
        "steps": steps,
        "mass_kg": report.mass_kg,
        "substeps": scenario.substeps or 1,
    }
    if is_turned(scenario):
        path = spin_airborne(fall_of(scenario), **_spin(scenario, report), **how)
    else:
        position_m, velocity_m_s = airborne(fall_of(scenario), **how)
        still = np.zeros_like(position_m)
        path = Tumbling(position_m, velocity_m_s, still, np.tile(UPRIGHT, (steps + 1, 1)))
    return Flight(*path, _first_clamped(scenario, report, path))


def is_turned(scenario: Scenario) -> bool:
    """Whether a body spins, or is released turned.

    In reduced coordinates the engine turns vectors into its frame and back, which rounds them.
    """
    return any(scenario.spin_rad_s) or scenario.orientation_xyzw != UPRIGHT


def _spin(scenario: Scenario, report: EngineReport) -> dict[str, Any]:
    return {
        "spin_rad_s": scenario.spin_rad_s,
        "angular_damping": effective_damping(scenario.angular_damping, scenario.coordinates),
        "inertia_kg_m2": report.inertia_kg_m2,
        "orientation_xyzw": scenario.orientation_xyzw,
    }


def _first_clamped(scenario: Scenario, report: EngineReport, path: Tumbling) -> int | None:
    limit, substeps = MAX_COORDINATE_VELOCITY_M_S, scenario.substeps or 1
    fastest = max(np.abs(path.velocity_m_s).max(), np.abs(path.spin_rad_s).max())
    # The limit leaves exactly ±100, which may be gone by the last of several substeps.
    if scenario.coordinates == "maximal" or (substeps == 1 and fastest < limit):
        return None
    with_it, without = (
        spinning(
            fall_of(scenario),
            **_spin(scenario, report),
            timestep_s=scenario.timestep_s / substeps,
            mass_kg=report.mass_kg,
            limit=each,
        )
        for each in (limit, math.inf)
    )
    both = zip(with_it, without, strict=True)
    for number, (one, other) in enumerate(islice(both, (len(path.position_m) - 1) * substeps + 1)):
        if one != other:
            return math.ceil(number / substeps)
    return None

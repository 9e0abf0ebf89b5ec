"""Splits the position error of a body in flight into its causes.

    simulated - free fall = timestep + damping + interaction + rounding

Timestep is the discretisation error of semi-implicit Euler in free fall, exact. Damping is the
difference between damped and free fall, both in continuous time: it does not vanish with the
timestep. Interaction is the further difference of the damped discrete law, evaluated in exact
arithmetic, from the sum of these two. Rounding is the further difference of the simulation, which
computes in double precision.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from decimal import Decimal

import numpy as np

from drop_physics.arrays import Float64, Vector
from drop_physics.physics import theory
from drop_physics.physics.base import Law, Motion, exactly
from drop_physics.physics.theory import TheoreticalFall
from drop_physics.physics.vectors import triple

TERMS = ("timestep", "damping", "interaction", "rounding")
STIFF = 1e3
"""Stiffness of a throw, as the number of times that drag could stop the body during the flight; the
integration of a stiffer throw takes too long."""


@dataclass(frozen=True)
class VectorTerms:
    """The four terms of a position error along x, y and z [m]; their sum is the error."""

    timestep: Vector
    """Error of semi-implicit Euler without damping."""
    damping: Vector
    """Effect of damping in continuous time."""
    interaction: Vector
    """Interaction of timestep and damping."""
    rounding: Vector
    """Rounding of double precision."""


@dataclass(frozen=True)
class Decomposition:
    """The error of each sample and its four terms [m], all of shape (samples, 3): x, y, z."""

    free_fall_m: Float64
    total_m: Float64
    timestep_m: Float64
    damping_m: Float64
    interaction_m: Float64
    rounding_m: Float64


Path = Iterator[Sequence[Decimal]]


def decompose(
    law: Law,
    fall: TheoreticalFall,
    simulated_m: Float64,
    *,
    first: int = 0,
    path: Path | None = None,
) -> Decomposition:
    """Split simulated minus exact free-fall position into four terms, at each sample.

    Parameters
    ----------
    law
        The discrete law that the engine follows.
    fall
        The start and the drag of the simulation.
    simulated_m
        Simulated positions of consecutive samples [m], shape (samples, 3). All of them must be in
        the air.
    first
        Step number of the first of these samples; 0 is the start.
    path
        The law's exact path, advanced to the first sample; None to compute it from the start.

    Returns
    -------
    The error and its terms, whose sum is the error up to the last bit of the largest term.
    """
    if not len(simulated_m):
        return Decomposition(*[np.empty((0, 3))] * len(fields(Decomposition)))
    last = first + len(simulated_m) - 1
    time_s = np.arange(first, last + 1, dtype=np.float64) * law.timestep_s
    free_fall_m = theory.free_fall_position(fall, time_s)
    timestep_m = np.zeros_like(free_fall_m)
    if law.semi_implicit:
        timestep_m = theory.timestep_displacement(fall, time_s, law.step_s)
    damping_m = theory.damping_displacement(fall, time_s)
    path = path or law.exact_path(fall.position_m, fall.velocity_m_s, first=first)
    law_m = exactly(path, len(simulated_m), fall.position_m)
    explained_m = free_fall_m + timestep_m + damping_m
    return Decomposition(
        free_fall_m=free_fall_m,
        total_m=simulated_m - free_fall_m,
        timestep_m=timestep_m,
        damping_m=damping_m,
        interaction_m=-law_m.difference(explained_m),
        rounding_m=law_m.difference(simulated_m),
    )


def error_and_terms(
    start: Motion, position_m: Float64, law: Law, *, steps: int
) -> tuple[Vector, VectorTerms | None]:
    """Return the position error of a flight after some steps, and its four terms [m].

    Parameters
    ----------
    start
        The motion at the sample from which the flight starts.
    position_m
        The position of the body after these steps [m], shape (3,).
    law
        The discrete law of the body. The terms are None if gravity is not along z, or if a throw is
        stiffer than `STIFF`.
    steps
        The number of steps, at least 1.
    """
    time_s, velocity_m_s = steps * law.timestep_s, start.velocity_m_s[0]
    stops = law.drag.quadratic_per_m * float(np.linalg.norm(velocity_m_s)) * time_s
    if any(law.gravity_m_s2[:2]) or (velocity_m_s[:2].any() and stops > STIFF):
        g = np.array(law.gravity_m_s2)
        free_fall_m = start.position_m[0] + (start.velocity_m_s[0] + g * time_s / 2) * time_s
        return triple(position_m - free_fall_m), None
    return _row(decompose(law, _fall_from(start, law), position_m[None], first=steps), 0)


def _fall_from(start: Motion, law: Law) -> TheoreticalFall:
    return TheoreticalFall(
        position_m=triple(start.position_m[0]),
        velocity_m_s=triple(start.velocity_m_s[0]),
        gravity_m_s2=law.gravity_m_s2[2],
        drag=law.drag,
    )


def _row(parts: Decomposition, row: int) -> tuple[Vector, VectorTerms]:
    terms = (triple(getattr(parts, f"{name}_m")[row]) for name in TERMS)
    return triple(parts.total_m[row]), VectorTerms(*terms)

"""Break down the error of a flight through the air.

    simulated - free fall = timestep + damping + interaction + rounding

Timestep is the discretisation error of semi-implicit Euler in free fall, exact. Damping is the
difference of two models, both in continuous time: it does not vanish with the timestep.
Interaction is what the damped discrete law adds to these two when it is evaluated in exact
arithmetic. Rounding is what the simulation's double precision adds to that.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drop_physics.laws import theory
from drop_physics.laws.base import Law
from drop_physics.laws.theory import Fall

Float64 = NDArray[np.float64]

TERMS = ("timestep", "damping", "interaction", "rounding")


@dataclass(frozen=True)
class Decomposition:
    """The error of each sample and its four terms [m], all of shape (samples, 3): x, y, z."""

    free_fall_m: Float64
    total_m: Float64
    timestep_m: Float64
    damping_m: Float64
    interaction_m: Float64
    rounding_m: Float64

    def first(self, samples: int) -> Self:
        """Return the first of the samples."""
        return type(self)(*(getattr(self, field.name)[:samples] for field in fields(self)))


def decompose(law: Law, fall: Fall, simulated_m: Float64, *, first: int = 0) -> Decomposition:
    """Break down simulated minus free-fall position, sample by sample.

    Parameters
    ----------
    law
        The discrete law that the engine follows.
    fall
        The start and the drag: what the simulation was given.
    simulated_m
        Simulated positions of consecutive samples [m], shape (samples, 3). All of them must be in
        the air.
    first
        Step number of the first of them; 0 is the start.

    Returns
    -------
    The error and its terms, which add up to it except for the last bit of the largest.
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
    law_m = law.exact_path(fall.position_m, fall.velocity_m_s, steps=last, first=first)
    explained_m = free_fall_m + timestep_m + damping_m
    return Decomposition(
        free_fall_m=free_fall_m,
        total_m=simulated_m - free_fall_m,
        timestep_m=timestep_m,
        damping_m=damping_m,
        interaction_m=-law_m.difference(explained_m),
        rounding_m=law_m.difference(simulated_m),
    )

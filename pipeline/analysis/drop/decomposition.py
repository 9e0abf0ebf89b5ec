"""Take the error of a fall through the air apart.

    simulated - free fall = timestep + damping + interaction + rounding

Timestep is the discretisation error of semi-implicit Euler in free fall, exact. Damping is the
difference of two models, both in continuous time: it does not vanish with the timestep.
Interaction is what the damped discrete law adds to these two when it is evaluated in exact
arithmetic. Rounding is what the simulation's double precision adds to that.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from pipeline.laws import bullet_air, theory
from pipeline.laws.theory import Fall

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Decomposition:
    """The error of each sample and its four terms [m], all of shape (samples,)."""

    free_fall_m: Float64
    total_m: Float64
    timestep_m: Float64
    damping_m: Float64
    interaction_m: Float64
    rounding_m: Float64


def decompose(
    fall: Fall, simulated_m: Float64, *, timestep_s: float, first: int = 0, substeps: int = 1
) -> Decomposition:
    """Take apart simulated minus free-fall height, sample by sample.

    Parameters
    ----------
    fall
        The release and the air: what the simulation was told to do.
    simulated_m
        Simulated heights of consecutive samples [m], shape (samples,). All of them must be in the
        air.
    timestep_s
        Timestep [s].
    first
        Step number of the first of them; 0 is the release.
    substeps
        How many steps the engine makes of each timestep.

    Returns
    -------
    The error and its terms. They add up to it but for the last bit of the largest.
    """
    if not len(simulated_m):
        return Decomposition(*[np.empty(0)] * len(fields(Decomposition)))
    last = first + len(simulated_m) - 1
    time_s = np.arange(first, last + 1, dtype=np.float64) * timestep_s
    free_fall_m = theory.free_fall_height(fall, time_s)
    timestep_m = theory.timestep_displacement(fall, time_s, timestep_s / substeps)
    damping_m = theory.damping_displacement(fall, time_s)
    law_m = bullet_air.airborne_exact(
        fall, timestep_s=timestep_s, steps=last, first=first, substeps=substeps
    )
    explained_m = free_fall_m + timestep_m + damping_m
    return Decomposition(
        free_fall_m=free_fall_m,
        total_m=simulated_m - free_fall_m,
        timestep_m=timestep_m,
        damping_m=damping_m,
        interaction_m=-bullet_air.difference(law_m, explained_m),
        rounding_m=bullet_air.difference(law_m, simulated_m),
    )

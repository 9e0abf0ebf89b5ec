"""Bullet's law of contact for a body that lands flat: impact, settling, rest, bounces.

Contact acts only after the body has gone into the floor, and in one step at a time: it gives the
body at least the velocity that restitution asks for, and a share of the penetration back per step.
That is the law of a solver that has converged: `solverResidualThreshold=0`, and iterations enough.
By default the solver stops micrometres earlier. A body that is no longer flat, turned over by its
floor or thrown sideways, is not covered. The floor is a btMultiBody, so that one solver serves both
kinds of body. File names and line numbers are bullet3's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.physics.bullet_law import vertical_velocity_law
from pipeline.physics.theory import Fall

Float64 = NDArray[np.float64]

CONTACT_SLOP_M = 1e-5
"""Penetration that is left alone: PhysicsServerCommandProcessor.cpp 2803, `m_linearSlop`."""
CONTACT_ERP = 0.08
"""Share of the penetration taken back per step: the same file, 2800, `m_erp2`."""
RESTITUTION_THRESHOLD_M_S = float(np.float32(0.2))
"""Slower bodies do not bounce: `btContactSolverInfo.h`, `m_restitutionVelocityThreshold`."""
FLOOR_HALF_THICKNESS_M = 5.0
"""plane.urdf is a box of 10 m; distances are rounded as its centre sees them, to 8.9e-16 m."""


def flat_drop(
    fall: Fall,
    *,
    timestep_s: float,
    steps: int,
    mass_kg: float,
    rest_height_m: float,
    restitution: float = 0.0,
    contact_erp: float = CONTACT_ERP,
    restitution_threshold_m_s: float = RESTITUTION_THRESHOLD_M_S,
    substeps: int = 1,
) -> tuple[Float64, Float64]:
    """Return heights [m] and vertical velocities [m/s] before each step and after the last.

    Shape (steps + 1,) each. `rest_height_m` is that of the body's centre where it just touches the
    floor, `restitution` that of the pair: body's times floor's (`btManifoldResult.cpp` 68-71). With
    d the distance to the floor and v' the velocity after a step in the air, the step in contact is
    `btMultiBodyConstraintSolver.cpp` 723-836:

        gap = d + slop;  v' = max(v', rebound - gap erp/dt)  or, where gap > 0, rebound - gap/dt

    The engine makes `substeps` steps of each timestep, of which the last is seen.
    """
    timestep_s, steps = timestep_s / substeps, steps * substeps
    free_velocity = vertical_velocity_law(fall, float, timestep_s, mass_kg)
    z, v = fall.height_m, fall.velocity_m_s[2]
    heights, velocities = np.full(steps + 1, z), np.full(steps + 1, v)
    seen, seen_step = (z, v), 0
    for step in range(1, steps + 1):
        v = free_velocity(v)
        distance = ((z + FLOOR_HALF_THICKNESS_M) - rest_height_m) - FLOOR_HALF_THICKNESS_M
        if distance <= 0:
            gap = distance + CONTACT_SLOP_M
            bounce = rebound_speed(v, restitution, threshold_m_s=restitution_threshold_m_s)
            v = max(v, bounce - gap * (contact_erp if gap <= 0 else 1.0) / timestep_s)
        z = z + timestep_s * v
        heights[step], velocities[step] = z, v
        # Rest is a cycle of a few states, some 1e-17 m apart. A state seen before repeats what
        # followed it, so that a long rest costs nothing (Brent's algorithm).
        if (z, v) == seen:
            for series in (heights, velocities):
                series[step:] = np.resize(series[seen_step:step], steps + 1 - step)
            break
        if step & (step - 1) == 0:
            seen, seen_step = (z, v), step
    return heights[::substeps], velocities[::substeps]


def rebound_speed(
    approach_m_s: float,
    restitution: float,
    *,
    threshold_m_s: float = RESTITUTION_THRESHOLD_M_S,
) -> float:
    """Return the speed that restitution gives back [m/s] to a body moving down at -`approach_m_s`.

    `btSequentialImpulseConstraintSolver.cpp` 494-502, `restitutionCurve`: none below the threshold.
    """
    return restitution * -approach_m_s if approach_m_s <= -threshold_m_s else 0.0


# -- bounces --------------------------------------------------------------------------------------


def rebound_heights(drop_height_m: float, restitution: float, bounces: int) -> Float64:
    """Return e^2 h, e^4 h, ...: the apexes above the floor of a perfect bounce [m], (bounces,).

    Each bounce leaves e of the speed, and so e² of the height, in free fall and without a timestep.
    """
    return drop_height_m * np.float64(restitution) ** (2 * np.arange(1, bounces + 1))


@dataclass(frozen=True, kw_only=True, slots=True)
class Bounce:
    """One contact that ended in the air again."""

    step: int
    """The last sample in free fall: the next step meets the floor."""
    approach_m_s: float
    """Downward speed that restitution acted on."""
    rebound_m_s: float
    """Upward speed that the contact gave: the greatest until the body is clear of the floor."""
    apex_m: float
    """Greatest height above the rest height before the next contact, or before the series ends."""

    @property
    def restitution(self) -> float:
        """The effective one: what restitution and the position correction together gave back."""
        return self.rebound_m_s / self.approach_m_s


def bounces(
    height_m: Float64,
    velocity_m_s: Float64,
    fall: Fall,
    *,
    timestep_s: float,
    mass_kg: float,
    rest_height_m: float,
) -> list[Bounce]:
    """Return the bounces of a series of heights and vertical velocities, simulated or predicted.

    A contact is a run of samples at or below the rest height. A run that does not end in upward
    motion clear of the floor is no bounce: its rebound was swallowed.
    """
    below = np.concatenate(([False], height_m <= rest_height_m, [False]))
    starts, ends = np.flatnonzero(np.diff(below.astype(np.int8))).reshape(-1, 2).T
    free_velocity = vertical_velocity_law(fall, float, timestep_s, mass_kg)
    found = []
    for start, end, following in zip(starts, ends, [*starts[1:], len(height_m)], strict=False):
        if end == len(height_m):
            break
        approach_m_s = -free_velocity(float(velocity_m_s[start]))
        if approach_m_s <= 0:  # released inside the floor: nothing has arrived
            continue
        found.append(
            Bounce(
                step=int(start),
                approach_m_s=approach_m_s,
                rebound_m_s=float(velocity_m_s[start + 1 : end + 1].max()),
                apex_m=float(height_m[end:following].max()) - rest_height_m,
            )
        )
    return found

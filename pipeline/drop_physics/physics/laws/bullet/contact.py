"""Bullet's contact model for a body that lands flat: impact, settling, rest, bounces.

Contact acts only in steps in which the body is inside the floor: it gives the body at least the
velocity that restitution requires, and corrects a share of the penetration per step. This is the
law of a converged solver (`solverResidualThreshold=0`, and enough iterations); with default
settings, the body rests micrometres away from it. Bodies that do not stay flat, or are thrown
sideways, are not covered. The floor is a btMultiBody, so the same solver is used for both kinds of
body. File names and line numbers refer to bullet3.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.physics.laws.bullet.air import BulletBody, velocity_law, vertical_velocity_law

CONTACT_SLOP_M = 1e-5
"""Penetration that is not corrected: PhysicsServerCommandProcessor.cpp 2803, `m_linearSlop`."""
CONTACT_ERP = 0.08
"""Share of the penetration that is corrected per step: `m_erp2`, PhysicsServerCommandProcessor.cpp
2800."""
RESTITUTION_THRESHOLD_M_S = float(np.float32(0.2))
"""Minimum approach speed of a bounce: `btContactSolverInfo.h`, `m_restitutionVelocityThreshold`."""
FLOOR_HALF_THICKNESS_M = 5.0
"""Half thickness of the floor [m]: plane.urdf is a box 10 m thick. Distances are rounded relative
to the box's centre, to 8.9e-16 m."""


LONGEST_CYCLE = 1 << 12
"""Maximum period, in samples, of the cycle that a resting body may follow."""


def flat_drop(
    body: BulletBody,
    *,
    height_m: float,
    velocity_m_s: float,
    rest_height_m: float,
    restitution: float = 0.0,
    contact_erp: float = CONTACT_ERP,
    restitution_threshold_m_s: float = RESTITUTION_THRESHOLD_M_S,
) -> Iterator[tuple[float, float]]:
    """Yield height [m] and vertical velocity [m/s] of each sample, indefinitely.

    The drop starts at `height_m` with `velocity_m_s`. `rest_height_m` is the height of the body's
    centre at which the body just touches the floor, `restitution` the product of the body's and the
    floor's coefficients (`btManifoldResult.cpp` 68-71). With d the distance to the floor and v' the
    velocity after a step in the air, contact gives (`btMultiBodyConstraintSolver.cpp` 723-836):

        gap = d + slop;  v' = max(v', rebound - gap erp/dt)  or, where gap > 0, rebound - gap/dt
    """
    step_s, free = body.step_s, vertical_velocity_law(body, float)
    z, v = height_m, velocity_m_s
    seen = z, v
    since: list[tuple[float, float]] = []
    yield z, v
    for sample in itertools.count(1):
        for _ in range(body.substeps):
            v = free(v)
            distance = ((z + FLOOR_HALF_THICKNESS_M) - rest_height_m) - FLOOR_HALF_THICKNESS_M
            if distance <= 0:
                gap = distance + CONTACT_SLOP_M
                bounce = rebound_speed(v, restitution, threshold_m_s=restitution_threshold_m_s)
                v = max(v, bounce - gap * (contact_erp if gap <= 0 else 1.0) / step_s)
            z = z + step_s * v
        yield z, v
        # Rest is a cycle of a few states, some 1e-17 m apart. Once a state recurs, so does all that
        # followed it: a long rest costs nothing (Brent's algorithm).
        if len(since) < LONGEST_CYCLE:
            since.append((z, v))
        if (z, v) == seen and since[-1] == seen:
            yield from itertools.cycle(since)
        if sample & (sample - 1) == 0:
            seen, since = (z, v), []


def rebound_speed(
    approach_m_s: float,
    restitution: float,
    *,
    threshold_m_s: float = RESTITUTION_THRESHOLD_M_S,
) -> float:
    """Return the rebound speed [m/s] of a body moving down at -`approach_m_s`.

    The rebound speed is 0 below the threshold (`btSequentialImpulseConstraintSolver.cpp` 494-502,
    `restitutionCurve`).
    """
    return restitution * -approach_m_s if approach_m_s <= -threshold_m_s else 0.0


def free_velocity(body: BulletBody, velocity_m_s: Sequence[float]) -> float:
    """Return the vertical velocity after a step without contact [m/s].

    `velocity_m_s` is the velocity before the step, with x and y because the drag depends on the
    speed.
    """
    after, (_, _, weight) = velocity_law(body, float)
    return after(float(velocity_m_s[2]), math.hypot(*velocity_m_s), weight)


def rebound_heights(drop_height_m: float, restitution: float, bounces: int) -> Float64:
    """Return e^2 h, e^4 h, ...: the apexes above the floor of a perfect bounce [m], (bounces,).

    Each bounce keeps the share e of the speed, and thus e² of the height, in free fall and
    continuous time.
    """
    return drop_height_m * np.float64(restitution) ** (2 * np.arange(1, bounces + 1))

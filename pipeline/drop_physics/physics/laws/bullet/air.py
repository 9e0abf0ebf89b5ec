"""Bullet's velocity update in the air, and the path in exact arithmetic.

The float version keeps the engine's order of operations. On x86-64, where each operation rounds
once, it equals PyBullet 3.2.7 in every bit, for a body that neither spins nor is rotated
(otherwise, see `laws/bullet/spin`). The exact version is the same law with 40 digits. File names
and line numbers refer to bullet3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import TypeVar

import numpy as np

from drop_physics.arrays import Vector
from drop_physics.physics.base import FreeBody
from drop_physics.scenario import Coordinates

Number = TypeVar("Number", float, Decimal)

DEFAULT_DAMPING = {"reduced": float(np.float32(0.04)), "maximal": 0.0}
"""Default linear and angular damping: `btMultiBody.cpp` 120-124 `m_linearDamping(0.04f)`;
`btRigidBody` 0."""
MAX_COORDINATE_VELOCITY_M_S = 100.0
"""Default limit of each component of velocity and spin: `btMultiBody.cpp` 124, `.h` 483-487."""
EPSILON = 2.220446049250313e-16
"""SIMD_EPSILON: a squared length up to this value counts as 0 (`btVector3::safeNorm`)."""


def effective_damping(damping: float | None, coordinates: Coordinates) -> float:
    """Return the coefficient that the engine uses if the linear or angular one is set to `damping`.

    None and negative values leave the default, since PyBullet passes only values of 0 and above.
    `btRigidBody` clamps the coefficient to 1 (`setDamping`), `btMultiBody` accepts any value.
    """
    if damping is None or damping < 0:
        return DEFAULT_DAMPING[coordinates]
    return damping if coordinates == "reduced" else min(damping, 1.0)


@dataclass(frozen=True, kw_only=True)
class BulletBody(FreeBody):
    """A rigid body with Bullet's own settings; damping is the engine's value, never None."""

    linear_damping: float
    angular_damping: float
    coordinates: Coordinates
    velocity_limit: float = MAX_COORDINATE_VELOCITY_M_S
    """Limit of each velocity component [m/s, rad/s]; in reduced coordinates only."""


# -- the law --------------------------------------------------------------------------------------


VelocityLaw = Callable[[Number, Number, Number], Number]
"""A function that maps velocity, speed (of all components) and force along an axis to the next
velocity."""


def velocity_law(
    body: BulletBody, number: Callable[[float], Number]
) -> tuple[VelocityLaw[Number], tuple[Number, Number, Number]]:
    """Return the velocity update of a step for one number type, and the body's weight [N].

    Reduced coordinates: v' = f/m - k v (1 + |v|), `btMultiBody.cpp` 842-843, divided by the mass in
    its `solveImatrix`, added and limited in `applyDeltaVeeMultiDof`.

    Maximal coordinates: damped by v *= (1 - k)^dt in `btRigidBody::applyDamping`, then accelerated
    by gravity in `btSequentialImpulseConstraintSolver.cpp` 477. The power is the double that the
    engine's `pow` returns, even in exact arithmetic: its rounding is the same in every step, so it
    acts as a slightly different damping, and does not average out.
    """
    dt, mass = number(body.step_s), number(body.mass_kg)
    gx, gy, gz = map(number, body.gravity_m_s2)
    inverse = 1 / mass
    if body.coordinates == "maximal":
        kept, weighed = number(math.pow(1.0 - body.linear_damping, body.step_s)), 1 / inverse
        weight = (gx * weighed, gy * weighed, gz * weighed)
        return lambda v, _, force: v * kept + force * inverse * dt, weight

    k, limit = number(body.linear_damping), number(body.velocity_limit)
    least = -limit

    def reduced(v: Number, speed: Number, force: Number) -> Number:
        v = v + -((-force + (mass * v) * (k + k * speed)) * inverse) * dt
        if least <= v <= limit:
            return v
        return limit if v > limit else least

    return reduced, (gx * mass, gy * mass, gz * mass)


def vertical_velocity_law(
    body: BulletBody, number: Callable[[float], Number]
) -> Callable[[Number], Number]:
    """Return the velocity update of a vertical step: a function from velocity to next velocity."""
    after, (_, _, weight) = velocity_law(body, number)
    zero, epsilon = number(0.0), number(EPSILON)
    return lambda v: after(v, abs(v) if v * v > epsilon else zero, weight)


# -- in exact arithmetic --------------------------------------------------------------------------


def exact_path(
    body: BulletBody, position_m: Vector, velocity_m_s: Vector
) -> Iterator[Sequence[Decimal]]:
    """Yield the positions before each step: z alone for a vertical flight, otherwise x, y, z.

    Timestep, gravity, damping and start state count as exact numbers, and so does the timestep
    divided by the number of substeps. The mass cancels.
    """
    body = replace(body, mass_kg=1.0)
    vertical = not any((*velocity_m_s[:2], *body.gravity_m_s2[:2]))
    return (_vertical if vertical else _in_space)(body, position_m, velocity_m_s)


def _vertical(
    body: BulletBody, position_m: Vector, velocity_m_s: Vector
) -> Iterator[tuple[Decimal]]:
    """Yield z before each step: semi-implicit Euler."""
    after = vertical_velocity_law(body, Decimal)
    z, v, dt = Decimal(position_m[2]), Decimal(velocity_m_s[2]), Decimal(body.step_s)
    while True:
        yield (z,)
        v = after(v)
        z = z + dt * v


def _in_space(
    body: BulletBody, position_m: Vector, velocity_m_s: Vector
) -> Iterator[tuple[Decimal, Decimal, Decimal]]:
    """Yield x, y, z before each step: semi-implicit Euler, coupled by the speed."""
    after, (fx, fy, fz) = velocity_law(body, Decimal)
    dt, zero, epsilon = Decimal(body.step_s), Decimal(0), Decimal(EPSILON)
    (x, y, z), (vx, vy, vz) = map(Decimal, position_m), map(Decimal, velocity_m_s)
    while True:
        yield x, y, z
        squared = vx * vx + vy * vy + vz * vz
        speed = squared.sqrt() if squared > epsilon else zero
        vx, vy, vz = after(vx, speed, fx), after(vy, speed, fy), after(vz, speed, fz)
        x, y, z = x + dt * vx, y + dt * vy, z + dt * vz

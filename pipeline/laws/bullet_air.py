"""The discrete step that Bullet takes in the air, bit for bit and in exact arithmetic.

The float versions keep the engine's order of operations. On x86-64, where each operation rounds
once, they equal PyBullet 3.2.7 in every bit, for a body that neither spins nor is turned at its
release (`spin_law` is for those). The exact version is the same law with 40 digits. File names and
line numbers are bullet3's.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import Context, Decimal, localcontext
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.laws.theory import Fall
from pipeline.scenario import Coordinates, Scenario

Float64 = NDArray[np.float64]
Number = TypeVar("Number", float, Decimal)

DEFAULT_DAMPING = {"reduced": float(np.float32(0.04)), "maximal": 0.0}
"""Linear and angular: `btMultiBody.cpp` 120-124 `m_linearDamping(0.04f)`; `btRigidBody` 0."""
MAX_COORDINATE_VELOCITY_M_S = 100.0
"""Of each component, spin too: `btMultiBody.cpp` 124, `btMultiBody.h` 483-487. Not in maximal."""
EPSILON = 2.220446049250313e-16
"""SIMD_EPSILON: a squared length up to this counts as none (`btVector3::safeNorm`)."""
EXACT_MACHINES = ("x86_64", "AMD64")
"""Those on which each operation rounds once."""
FUSED = 1e-12
"""Relative difference that a compiler may make elsewhere, where it fuses multiply and add."""


def effective_damping(damping: float | None, coordinates: Coordinates) -> float:
    """Return the coefficient that the engine uses, linear or angular, when told `damping`.

    None and negative values leave the default: PyBullet passes on 0 and more. `btRigidBody`
    clamps to 1 (`setDamping`), `btMultiBody` takes any value.
    """
    if damping is None or damping < 0:
        return DEFAULT_DAMPING[coordinates]
    return damping if coordinates == "reduced" else min(damping, 1.0)


def fall_of(scenario: Scenario) -> Fall:
    """Return the release and the air of a scenario, as the engine has them."""
    return Fall(
        height_m=scenario.height_m,
        velocity_m_s=scenario.velocity_m_s,
        gravity_m_s2=scenario.effective_gravity_m_s2,
        linear_damping=effective_damping(scenario.linear_damping, scenario.coordinates),
        coordinates=scenario.coordinates,
    )


# -- the law --------------------------------------------------------------------------------------


VelocityLaw = Callable[[Number, Number, Number], Number]
"""From velocity, speed (of all three components) and force along an axis to the next velocity."""


def velocity_law(
    fall: Fall, number: Callable[[float], Number], timestep_s: float, mass_kg: float
) -> tuple[VelocityLaw[Number], Number]:
    """Return the velocity's part of a step for numbers of one kind, and the body's weight [N].

    Reduced: v' = f/m - k v (1 + |v|), `btMultiBody.cpp` 842-843, divided by the mass in its
    `solveImatrix`, added and limited in `applyDeltaVeeMultiDof`.

    Maximal: damped by v *= (1 - k)^dt in `btRigidBody::applyDamping`, then pulled in
    `btSequentialImpulseConstraintSolver.cpp` 477. That power is the double which the engine's pow
    returns, in exact arithmetic too: rounded once, it acts in every step alike. It is a slightly
    other damping, not rounding that averages out.
    """
    dt, g, mass = number(timestep_s), number(fall.gravity_m_s2), number(mass_kg)
    inverse = 1 / mass
    if fall.coordinates == "maximal":
        kept = number(math.pow(1.0 - fall.linear_damping, timestep_s))
        return lambda v, _, force: v * kept + force * inverse * dt, g * (1 / inverse)

    k, limit = number(fall.linear_damping), number(MAX_COORDINATE_VELOCITY_M_S)
    least = -limit

    def reduced(v: Number, speed: Number, force: Number) -> Number:
        v = v + -((-force + (mass * v) * (k + k * speed)) * inverse) * dt
        if least <= v <= limit:
            return v
        return limit if v > limit else least

    return reduced, g * mass


def vertical_velocity_law(
    fall: Fall, number: Callable[[float], Number], timestep_s: float, mass_kg: float
) -> Callable[[Number], Number]:
    """Return the same for a body that moves straight up or down: from velocity to next velocity."""
    after, weight = velocity_law(fall, number, timestep_s, mass_kg)
    zero, epsilon = number(0.0), number(EPSILON)
    return lambda v: after(v, abs(v) if v * v > epsilon else zero, weight)


def velocities_after_step(fall: Fall, velocity_m_s: Float64, *, timestep_s: float) -> Float64:
    """Return what one step makes of many velocities at once [m/s], shape (n, 3), before `held`.

    The same law, but in arrays, and so not to the last bit.
    """
    pull = np.array([0.0, 0.0, fall.gravity_m_s2 * timestep_s])
    if fall.coordinates == "maximal":
        return np.asarray(velocity_m_s * (1 - fall.linear_damping) ** timestep_s + pull)
    speed = np.linalg.norm(velocity_m_s, axis=1, keepdims=True)
    return np.asarray(
        velocity_m_s - timestep_s * fall.linear_damping * velocity_m_s * (1 + speed) + pull
    )


def held(fall: Fall, velocity_m_s: Float64) -> Float64:
    """Return velocities [m/s], shape (n, 3), within the limit that a btMultiBody is held to."""
    if fall.coordinates == "maximal":
        return velocity_m_s
    return np.clip(velocity_m_s, -MAX_COORDINATE_VELOCITY_M_S, MAX_COORDINATE_VELOCITY_M_S)


def _vertical_samples(
    fall: Fall, number: Callable[[float], Number], timestep_s: float, steps: int, mass_kg: float
) -> Iterator[tuple[Number, Number]]:
    """Yield (z, vz) before each step and after the last: semi-implicit Euler."""
    after = vertical_velocity_law(fall, number, timestep_s, mass_kg)
    z, v, dt = number(fall.height_m), number(fall.velocity_m_s[2]), number(timestep_s)
    yield z, v
    for _ in range(steps):
        v = after(v)
        z = z + dt * v
        yield z, v


def _samples(
    fall: Fall,
    number: Callable[[float], Number],
    root: Callable[[Number], Number],
    timestep_s: float,
    steps: int,
    mass_kg: float,
) -> Iterator[tuple[Number, Number, Number, Number, Number, Number]]:
    """Yield (x, y, z, vx, vy, vz): the same in space, coupled by the speed."""
    after, weight = velocity_law(fall, number, timestep_s, mass_kg)
    dt, zero, epsilon = number(timestep_s), number(0.0), number(EPSILON)
    x, y, z = zero, zero, number(fall.height_m)
    vx, vy, vz = map(number, fall.velocity_m_s)
    yield x, y, z, vx, vy, vz
    for _ in range(steps):
        squared = vx * vx + vy * vy + vz * vz
        speed = root(squared) if squared > epsilon else zero
        vx, vy, vz = after(vx, speed, zero), after(vy, speed, zero), after(vz, speed, weight)
        x, y, z = x + dt * vx, y + dt * vy, z + dt * vz
        yield x, y, z, vx, vy, vz


def _is_vertical(fall: Fall) -> bool:
    return fall.velocity_m_s[0] == fall.velocity_m_s[1] == 0


# -- what it makes of a fall ----------------------------------------------------------------------


def airborne(
    fall: Fall, *, timestep_s: float, steps: int, mass_kg: float, substeps: int = 1
) -> tuple[Float64, Float64]:
    """Return positions [m] and velocities [m/s] before each step and after the last.

    Shape (steps + 1, 3). PyBullet's, bit for bit, at any mass. Spin changes the fall by rounding
    only: in reduced coordinates the engine then turns vectors into the body's frame and back.
    The engine makes `substeps` steps of each timestep, of which the last is seen.
    """
    table, every = np.zeros((steps + 1, 6)), substeps
    timestep_s, steps = timestep_s / substeps, steps * substeps
    if _is_vertical(fall):
        pairs = _vertical_samples(fall, float, timestep_s, steps, mass_kg)
        table[:, 2::3] = np.fromiter(
            itertools.islice(pairs, 0, None, every), np.dtype((np.float64, 2)), len(table)
        )
    else:
        rows = _samples(fall, float, math.sqrt, timestep_s, steps, mass_kg)
        table[:] = np.fromiter(
            itertools.islice(rows, 0, None, every), np.dtype((np.float64, 6)), len(table)
        )
    return table[:, :3], table[:, 3:]


@dataclass(frozen=True, slots=True)
class ExactHeights:
    """Heights in two doubles [m], shape (n,): the nearest one, and what that leaves out."""

    nearest_m: Float64
    left_out_m: Float64


def airborne_exact(
    fall: Fall, *, timestep_s: float, steps: int, first: int = 0, substeps: int = 1
) -> ExactHeights:
    """Return the heights of the law in exact arithmetic: 40 digits, in which the mass cancels.

    From sample `first` on, shape (steps + 1 - first,). Timestep, gravity, damping and release are
    the doubles they are, taken for exact; so is the timestep over its substeps.
    """
    nearest, left_out = np.empty(steps + 1 - first), np.empty(steps + 1 - first)
    timestep_s, steps = timestep_s / substeps, steps * substeps
    with localcontext(Context(prec=40)):
        heights = (
            (z for z, _ in _vertical_samples(fall, Decimal, timestep_s, steps, 1.0))
            if _is_vertical(fall)
            else (row[2] for row in _samples(fall, Decimal, Decimal.sqrt, timestep_s, steps, 1.0))
        )
        seen = itertools.islice(heights, first * substeps, None, substeps)
        for place, height in enumerate(seen):
            nearest[place] = near = float(height)
            left_out[place] = float(height - Decimal(near))
    return ExactHeights(nearest, left_out)


def difference(exact: ExactHeights, reference_m: Float64) -> Float64:
    """Return reference - exact [m], to the last bit; the shape of `reference_m`.

    Near doubles have an exact difference (Sterbenz), so that only the second subtraction rounds.
    """
    return (reference_m - exact.nearest_m) - exact.left_out_m

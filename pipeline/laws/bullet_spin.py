"""The step that Bullet takes with a body that falls and spins, bit for bit.

The engine's order of operations is kept, as in `bullet_law`; only sin, cos and pow come from the C
library, PyBullet's own where both run on the same machine. File names are bullet3's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.laws.bullet_air import EPSILON, MAX_COORDINATE_VELOCITY_M_S
from pipeline.laws.theory import Fall

Float64 = NDArray[np.float64]
Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Quaternion = tuple[float, float, float, float]

State = tuple[Vector, Vector, Vector, Quaternion]
"""Position [m], velocity [m/s], spin [rad/s], orientation as the engine keeps it."""
_Step = Callable[[Vector, Vector, Vector, Quaternion], State]

MAX_TURN_RAD = 0.5 * (math.pi * 0.5)
"""ANGULAR_MOTION_THRESHOLD: in one step no body turns further (`btTransformUtil.h` 19)."""


class Tumbling(NamedTuple):
    """A body before each step and after the last, in world axes; rows of shape (steps + 1, ...)."""

    position_m: Float64
    velocity_m_s: Float64
    spin_rad_s: Float64
    orientation_xyzw: Float64


def spin_airborne(
    fall: Fall,
    *,
    spin_rad_s: Vector,
    angular_damping: float,
    inertia_kg_m2: Vector,
    timestep_s: float,
    steps: int,
    mass_kg: float,
    orientation_xyzw: Quaternion = (0.0, 0.0, 0.0, 1.0),
    substeps: int = 1,
) -> Tumbling:
    """Return how a body falls and spins, turned or not at its release.

    PyBullet's, bit for bit where sin and cos are the same C library's; orientations up to sign.
    `angular_damping` is the engine's own (`effective_damping`), the inertia about the body's axes.
    The engine makes `substeps` steps of each timestep, of which the last is seen.
    """
    states = spinning(
        fall,
        spin_rad_s=spin_rad_s,
        angular_damping=angular_damping,
        inertia_kg_m2=inertia_kg_m2,
        timestep_s=timestep_s / substeps,
        mass_kg=mass_kg,
        orientation_xyzw=orientation_xyzw,
    )
    seen = islice(states, 0, steps * substeps + 1, substeps)
    parts = zip(*((x, v, w, _quaternion(_matrix(q))) for x, v, w, q in seen), strict=True)
    return Tumbling(*(np.array(each, dtype=np.float64) for each in parts))


def spinning(
    fall: Fall,
    *,
    spin_rad_s: Vector,
    angular_damping: float,
    inertia_kg_m2: Vector,
    timestep_s: float,
    mass_kg: float,
    orientation_xyzw: Quaternion,
    limit: float = MAX_COORDINATE_VELOCITY_M_S,
) -> Iterator[State]:
    """Yield the state before each step, without end; `limit` is that of reduced coordinates."""
    step: _Step
    if fall.coordinates == "reduced":
        step = _reduced_step(fall, angular_damping, inertia_kg_m2, timestep_s, mass_kg, limit)
    else:
        step = _maximal_step(fall, angular_damping, inertia_kg_m2, timestep_s, mass_kg)
    state: State = (0.0, 0.0, fall.height_m), fall.velocity_m_s, spin_rad_s, orientation_xyzw
    while True:
        yield state
        state = step(*state)


def _reduced_step(
    fall: Fall, damping: float, inertia: Vector, dt: float, mass: float, limit: float
) -> _Step:
    """Return the step of `btMultiBody.cpp` 754-774: explicit Euler for spin, in the body's frame.

    ω' = I⁻¹ [-ω × Iω - I ω k (1 + |ω|)]. The terms m ω × v of that frame cancel but for rounding.
    """
    k, inverse, turns = fall.linear_damping, 1.0 / mass, min(inertia) >= EPSILON
    weight = (0.0, 0.0, fall.gravity_m_s2 * mass)

    def limited(v: Vector, rate: Vector) -> Vector:
        x, y, z = _sum(v, _scaled(rate, dt))
        return min(max(x, -limit), limit), min(max(y, -limit), limit), min(max(z, -limit), limit)

    def step(x: Vector, v: Vector, w: Vector, q: Quaternion) -> State:
        to_body, to_world = _matrix(_conjugate(q)), _matrix(q)
        spin, velocity, pull = _times(to_body, w), _times(to_body, v), _times(to_body, weight)
        momentum, turning = _each(inertia, spin), _cross(spin, velocity)
        torque = _scaled(momentum, damping + damping * _safe_length(spin))
        torque = _sum(torque, _cross(spin, momentum))
        force = _scaled(_scaled(velocity, mass), k + k * _safe_length(velocity))
        force = _sum(_sum(_scaled(pull, -1.0), force), _scaled(turning, mass))
        # `solveImatrix`: a body with any smaller inertia keeps its spin
        spun = _scaled(_divided(torque, inertia), -1.0) if turns else (0.0, 0.0, 0.0)
        w = limited(w, _times(to_world, spun))
        v = limited(v, _times(to_world, _sum(_scaled(force, -inverse), turning)))
        # m_baseQuat turns the other way, world to body, and its product rounds the other way
        turn = _conjugate(_turn(w, math.sqrt(_dot(w, w)), dt))
        return _sum(x, _scaled(v, dt)), v, w, _conjugate(_unit(_product(_conjugate(q), turn)))

    return step


def _maximal_step(fall: Fall, damping: float, inertia: Vector, dt: float, mass: float) -> _Step:
    """Return the step of `btRigidBody.cpp`: one Newton iteration of implicit Euler for the spin.

    `computeGyroscopicImpulseImplicit_Body`. Its `solve33` does not divide by a determinant up to
    EPSILON: a body with inertias below some 6e-6 kg m² feels next to none of that torque.
    """
    kept, kept_spin = math.pow(1.0 - fall.linear_damping, dt), math.pow(1.0 - damping, dt)
    inverse = 1.0 / mass
    gained = (0.0, 0.0, fall.gravity_m_s2 * (1.0 / inverse) * inverse * dt)
    ix, iy, iz = inertia = _inverted(_inverted(inertia))

    def step(x: Vector, v: Vector, w: Vector, q: Quaternion) -> State:
        v, w, q = _scaled(v, kept), _scaled(w, kept_spin), _quaternion(_matrix(q))
        wx, wy, wz = spin = _rotated(_conjugate(q), w)
        lx, ly, lz = momentum = _each(inertia, spin)
        residual = _scaled(_cross(spin, momentum), dt)
        first = (ix, (wz * ix - lz) * dt, (ly - wy * ix) * dt)  # the Jacobian's columns
        second = ((lz - wz * iy) * dt, iy, (wx * iy - lx) * dt)
        third = ((wy * iz - ly) * dt, (lx - wx * iz) * dt, iz)
        determinant = _dot(first, _cross(second, third))
        scale = 1.0 / determinant if abs(determinant) > EPSILON else determinant
        newton = (
            scale * _dot(residual, _cross(second, third)),
            scale * _dot(first, _cross(residual, third)),
            scale * _dot(first, _cross(second, residual)),
        )
        spun = _rotated(q, _sum(spin, _scaled(newton, -1.0)))
        w = _sum(w, _sum(spun, _scaled(w, -1.0)))
        v = _sum(v, gained)
        return _sum(x, _scaled(v, dt)), v, w, _unit(_product(_turn(w, _safe_length(w), dt), q))

    return step


def _turn(w: Vector, rate: float, dt: float) -> Quaternion:
    """Return the turn of one step: the exponential map of `btTransformUtil::integrateTransform`."""
    rate = MAX_TURN_RAD / dt if rate * dt > MAX_TURN_RAD else rate
    taylor = 0.5 * dt - (dt * dt * dt) * 0.020833333333 * rate * rate
    x, y, z = _scaled(w, taylor if rate < 0.001 else math.sin(0.5 * rate * dt) / rate)
    return x, y, z, math.cos(rate * dt * 0.5)


def _unit(q: Quaternion) -> Quaternion:
    s = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * s, q[1] * s, q[2] * s, q[3] * s


def _conjugate(q: Quaternion) -> Quaternion:
    return -q[0], -q[1], -q[2], q[3]


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _safe_length(a: Vector) -> float:
    return math.sqrt(_dot(a, a)) if _dot(a, a) > EPSILON else 0.0


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _scaled(a: Vector, s: float) -> Vector:
    return a[0] * s, a[1] * s, a[2] * s


def _inverted(a: Vector) -> Vector:
    """`btRigidBody::setMassProps`, where none stays none."""
    return tuple(1.0 / part if part else 0.0 for part in a)  # type: ignore[return-value]


def _divided(a: Vector, b: Vector) -> Vector:
    return a[0] / b[0], a[1] / b[1], a[2] / b[2]


def _each(a: Vector, b: Vector) -> Vector:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _times(m: Matrix, a: Vector) -> Vector:
    return _dot(m[0], a), _dot(m[1], a), _dot(m[2], a)


def _matrix(q: Quaternion) -> Matrix:
    """`btMatrix3x3::setRotation`."""
    x, y, z, w = q
    s = 2.0 / (x * x + y * y + z * z + w * w)
    xs, ys, zs = x * s, y * s, z * s
    return (
        (1.0 - (y * ys + z * zs), x * ys - w * zs, x * zs + w * ys),
        (x * ys + w * zs, 1.0 - (x * xs + z * zs), y * zs - w * xs),
        (x * zs - w * ys, y * zs + w * xs, 1.0 - (x * xs + y * ys)),
    )


def _quaternion(m: Matrix) -> Quaternion:
    """`btMatrix3x3::getRotation`."""
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace > 0.0:
        root = math.sqrt(trace + 1.0)
        s = 0.5 / root
        x, y, z = m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]
        return x * s, y * s, z * s, root * 0.5
    i = max(range(3), key=lambda axis: m[axis][axis])
    j, k = (i + 1) % 3, (i + 2) % 3
    root = math.sqrt(m[i][i] - m[j][j] - m[k][k] + 1.0)
    s, q = 0.5 / root, [0.0] * 4
    q[i], q[3] = root * 0.5, (m[k][j] - m[j][k]) * s
    q[j], q[k] = (m[j][i] + m[i][j]) * s, (m[k][i] + m[i][k]) * s
    return q[0], q[1], q[2], q[3]


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    return (
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2],
        a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


def _rotated(q: Quaternion, a: Vector) -> Vector:
    """`quatRotate`."""
    turned = _product(_product(q, (*a, 0.0)), _conjugate(q))
    return turned[0], turned[1], turned[2]

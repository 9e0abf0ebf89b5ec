"""Bullet's step of a body that falls and spins, in the engine's order of operations.

Written once, for vectors whose components are numbers or arrays. With floats, and the C library's
sin and cos, it equals PyBullet bit for bit over any number of steps from the release. With arrays
it takes one step from each of many samples; numpy's sin and cos may differ in the last bit, and
only the orientation depends on them. File names are bullet3's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from drop_physics.laws.bullet_air import EPSILON, BulletBody

Number: TypeAlias = Any
"""A float, or an array of floats."""
Vector: TypeAlias = tuple[Number, Number, Number]
Matrix: TypeAlias = tuple[Vector, Vector, Vector]
Quaternion: TypeAlias = tuple[Number, Number, Number, Number]
Velocities: TypeAlias = Callable[[Vector, Vector, Quaternion], tuple[Vector, Vector]]
"""From velocity [m/s], spin [rad/s] and orientation to velocity and spin after the step."""

MAX_TURN_RAD = 0.5 * (math.pi * 0.5)
"""ANGULAR_MOTION_THRESHOLD: the most a body turns in a step (`btTransformUtil.h` 19)."""


@dataclass(frozen=True)
class Arithmetic:
    """The operations on numbers of one kind besides + - × ÷."""

    sqrt: Callable[[Number], Number]
    sin: Callable[[Number], Number]
    cos: Callable[[Number], Number]
    where: Callable[[Any, Number, Number], Number]
    """From a condition and two values to one of them; both are evaluated."""


ARRAYS = Arithmetic(np.sqrt, np.sin, np.cos, np.where)


def velocities(body: BulletBody, on: Arithmetic) -> Velocities:
    """Return the velocity part of a step."""
    return _maximal(body, on) if body.coordinates == "maximal" else _reduced(body, on)


def _reduced(body: BulletBody, on: Arithmetic) -> Velocities:
    """Return the step of `btMultiBody.cpp` 754-774: explicit Euler for spin, in the body's frame.

    ω' = I⁻¹ [-ω × Iω - I ω k (1 + |ω|)]. The terms m ω × v of that frame cancel except for
    rounding.
    """
    k, damping, mass, dt = body.linear_damping, body.angular_damping, body.mass_kg, body.step_s
    limit = body.velocity_limit
    inertia, turns = body.inertia_kg_m2, min(body.inertia_kg_m2) >= EPSILON
    inverse, weight = 1.0 / mass, _scaled(body.gravity_m_s2, mass)

    def limited(v: Vector, rate: Vector) -> Vector:
        x, y, z = _sum(v, _scaled(rate, dt))
        return held(x), held(y), held(z)

    def held(v: Number) -> Number:
        return on.where(v > limit, limit, on.where(v < -limit, -limit, v))

    def after(v: Vector, w: Vector, q: Quaternion) -> tuple[Vector, Vector]:
        to_body, to_world = matrix(conjugate(q)), matrix(q)
        spin, velocity, pull = _times(to_body, w), _times(to_body, v), _times(to_body, weight)
        momentum, turning = _each(inertia, spin), _cross(spin, velocity)
        torque = _scaled(momentum, damping + damping * _safe_length(spin, on))
        torque = _sum(torque, _cross(spin, momentum))
        force = _scaled(_scaled(velocity, mass), k + k * _safe_length(velocity, on))
        force = _sum(_sum(_scaled(pull, -1.0), force), _scaled(turning, mass))
        # `solveImatrix`: a body with any smaller inertia keeps its spin
        spun = _scaled(_divided(torque, inertia), -1.0) if turns else _scaled(torque, 0.0)
        return (
            limited(v, _times(to_world, _sum(_scaled(force, -inverse), turning))),
            limited(w, _times(to_world, spun)),
        )

    return after


def _maximal(body: BulletBody, on: Arithmetic) -> Velocities:
    """Return the step of `btRigidBody.cpp`: one Newton iteration of implicit Euler for the spin.

    `computeGyroscopicImpulseImplicit_Body`. Its `solve33` does not divide by a determinant up to
    EPSILON: a body with inertias below some 6e-6 kg m² feels almost none of that torque.
    """
    dt, inverse = body.step_s, 1.0 / body.mass_kg
    kept = math.pow(1.0 - body.linear_damping, dt)
    kept_spin = math.pow(1.0 - body.angular_damping, dt)
    gx, gy, gz = (g * (1.0 / inverse) * inverse * dt for g in body.gravity_m_s2)
    ix, iy, iz = inertia = _inverted(_inverted(body.inertia_kg_m2))

    def after(v: Vector, w: Vector, q: Quaternion) -> tuple[Vector, Vector]:
        v, w = _scaled(v, kept), _scaled(w, kept_spin)
        wx, wy, wz = spin = _rotated(conjugate(q), w)
        lx, ly, lz = momentum = _each(inertia, spin)
        residual = _scaled(_cross(spin, momentum), dt)
        first = (ix, (wz * ix - lz) * dt, (ly - wy * ix) * dt)  # the Jacobian's columns
        second = ((lz - wz * iy) * dt, iy, (wx * iy - lx) * dt)
        third = ((wy * iz - ly) * dt, (lx - wx * iz) * dt, iz)
        determinant = _dot(first, _cross(second, third))
        regular = abs(determinant) > EPSILON
        scale = on.where(regular, 1.0 / on.where(regular, determinant, 1.0), determinant)
        newton = (
            scale * _dot(residual, _cross(second, third)),
            scale * _dot(first, _cross(residual, third)),
            scale * _dot(first, _cross(second, residual)),
        )
        spun = _rotated(q, _sum(spin, _scaled(newton, -1.0)))
        w = _sum(w, _sum(spun, _scaled(w, -1.0)))
        return _sum(v, (gx, gy, gz)), w

    return after


def turned(body: BulletBody, on: Arithmetic, q: Quaternion, w: Vector) -> Quaternion:
    """Return the orientation after a step that ends with this spin [rad/s], as the engine has it.

    The exponential map of `btTransformUtil::integrateTransform`.
    """
    dt, reduced = body.step_s, body.coordinates == "reduced"
    rate = on.sqrt(_dot(w, w)) if reduced else _safe_length(w, on)
    rate = on.where(rate * dt > MAX_TURN_RAD, MAX_TURN_RAD / dt, rate)
    slow = rate < 0.001
    taylor = 0.5 * dt - (dt * dt * dt) * 0.020833333333 * rate * rate
    sine = on.sin(0.5 * rate * dt) / on.where(slow, 1.0, rate)
    x, y, z = _scaled(w, on.where(slow, taylor, sine))
    turn = x, y, z, on.cos(rate * dt * 0.5)
    if reduced:  # m_baseQuat is world to body, and its product rounds the other way
        return conjugate(_unit(_product(conjugate(q), conjugate(turn)), on))
    return _unit(_product(turn, q), on)


def _unit(q: Quaternion, on: Arithmetic) -> Quaternion:
    s = 1.0 / on.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * s, q[1] * s, q[2] * s, q[3] * s


def conjugate(q: Quaternion) -> Quaternion:
    """Return the inverse rotation."""
    return -q[0], -q[1], -q[2], q[3]


def _dot(a: Vector, b: Vector) -> Number:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _safe_length(a: Vector, on: Arithmetic) -> Number:
    squared = _dot(a, a)
    return on.where(squared > EPSILON, on.sqrt(squared), 0.0)


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _scaled(a: Vector, s: Number) -> Vector:
    return a[0] * s, a[1] * s, a[2] * s


def _inverted(a: Vector) -> Vector:
    """`btRigidBody::setMassProps`, where 0 stays 0."""
    x, y, z = (1.0 / part if part else 0.0 for part in a)
    return x, y, z


def _divided(a: Vector, b: Vector) -> Vector:
    return a[0] / b[0], a[1] / b[1], a[2] / b[2]


def _each(a: Vector, b: Vector) -> Vector:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _times(m: Matrix, a: Vector) -> Vector:
    return _dot(m[0], a), _dot(m[1], a), _dot(m[2], a)


def matrix(q: Quaternion) -> Matrix:
    """`btMatrix3x3::setRotation`."""
    x, y, z, w = q
    s = 2.0 / (x * x + y * y + z * z + w * w)
    xs, ys, zs = x * s, y * s, z * s
    return (
        (1.0 - (y * ys + z * zs), x * ys - w * zs, x * zs + w * ys),
        (x * ys + w * zs, 1.0 - (x * xs + z * zs), y * zs - w * xs),
        (x * zs - w * ys, y * zs + w * xs, 1.0 - (x * xs + y * ys)),
    )


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    return (
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2],
        a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


def _rotated(q: Quaternion, a: Vector) -> Vector:
    """`quatRotate`."""
    x, y, z, _ = _product(_product(q, (*a, 0.0)), conjugate(q))
    return x, y, z

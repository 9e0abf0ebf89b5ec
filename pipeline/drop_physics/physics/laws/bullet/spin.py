"""Bullet's step of a falling and spinning body, in the engine's order of operations.

Functions make one step from each of n samples: vectors have the shape (3, n), quaternions x, y, z,
w (4, n). With sin and cos of the C library the result equals PyBullet's bit for bit over any number
of steps from the release. Those of numpy may differ in the last bit, which affects only the
orientation. File names refer to bullet3.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.physics.columns import cross, dot, rotation, times
from drop_physics.physics.laws.bullet.air import EPSILON, BulletBody

MAX_TURN_RAD = 0.5 * (math.pi * 0.5)
"""ANGULAR_MOTION_THRESHOLD: the maximum rotation of a body in a step (`btTransformUtil.h` 19)."""


def velocities(body: BulletBody, v: Float64, w: Float64, q: Float64) -> tuple[Float64, Float64]:
    """Return velocity [m/s] and spin [rad/s] after a step from state v, w and q."""
    return (_maximal if body.coordinates == "maximal" else _reduced)(body, v, w, q)


def _reduced(body: BulletBody, v: Float64, w: Float64, q: Float64) -> tuple[Float64, Float64]:
    """Return the step of `btMultiBody.cpp` 754-774: explicit Euler for spin, in the body's frame.

    ω' = I⁻¹ [-ω × Iω - I ω k (1 + |ω|)]. In the body's frame there are also terms m ω × v, which
    cancel except for rounding.
    """
    k, damping, mass = body.linear_damping, body.angular_damping, body.mass_kg
    inertia, weight = _fixed(body.inertia_kg_m2), _fixed(body.gravity_m_s2) * mass
    to_body, to_world = rotation(conjugate(q)), rotation(q)
    spin, velocity = times(to_body, w), times(to_body, v)
    pull = times(to_body, np.broadcast_to(weight, v.shape))
    momentum, turning = inertia * spin, cross(spin, velocity)
    torque = momentum * (damping + damping * _safe_length(spin)) + cross(spin, momentum)
    force = velocity * mass * (k + k * _safe_length(velocity))
    force = pull * -1.0 + force + turning * mass
    # `solveImatrix`: a body with any smaller inertia keeps its spin
    spun = torque / inertia * -1.0 if min(body.inertia_kg_m2) >= EPSILON else torque * 0.0
    pulled = force * -(1.0 / mass) + turning
    v = v + times(to_world, pulled) * body.step_s
    w = w + times(to_world, spun) * body.step_s
    limit = body.velocity_limit
    return np.clip(v, -limit, limit), np.clip(w, -limit, limit)


def _maximal(body: BulletBody, v: Float64, w: Float64, q: Float64) -> tuple[Float64, Float64]:
    """Return the step of `btRigidBody.cpp`: one Newton iteration of implicit Euler for the spin.

    The iteration is `computeGyroscopicImpulseImplicit_Body`. Its function `solve33` does not divide
    by a determinant up to EPSILON: a body with inertias below about 6e-6 kg m² is hardly affected
    by the gyroscopic torque.
    """
    dt, inverse = body.step_s, 1.0 / body.mass_kg
    pull = _fixed(body.gravity_m_s2) * (1.0 / inverse) * inverse * dt
    v = v * math.pow(1.0 - body.linear_damping, dt)
    w = w * math.pow(1.0 - body.angular_damping, dt)
    # `btRigidBody::setMassProps` inverts them, where 0 stays 0.
    ix, iy, iz = inertia = _inverted(_inverted(_fixed(body.inertia_kg_m2)))
    wx, wy, wz = spin = _rotated(conjugate(q), w)
    lx, ly, lz = momentum = inertia * spin
    residual = cross(spin, momentum) * dt
    one = np.ones_like(wx)
    first = np.array((ix * one, (wz * ix - lz) * dt, (ly - wy * ix) * dt))  # the Jacobian's columns
    second = np.array(((lz - wz * iy) * dt, iy * one, (wx * iy - lx) * dt))
    third = np.array(((wy * iz - ly) * dt, (lx - wx * iz) * dt, iz * one))
    determinant = dot(first, cross(second, third))
    regular = abs(determinant) > EPSILON
    scale = np.where(regular, 1.0 / np.where(regular, determinant, 1.0), determinant)
    newton = scale * np.array(
        (
            dot(residual, cross(second, third)),
            dot(first, cross(residual, third)),
            dot(first, cross(second, residual)),
        )
    )
    spun = _rotated(q, spin + newton * -1.0)
    return v + pull, w + (spun + w * -1.0)


def turned(
    body: BulletBody,
    q: Float64,
    w: Float64,
    *,
    sin: Callable[[Float64], Float64] = np.sin,
    cos: Callable[[Float64], Float64] = np.cos,
) -> Float64:
    """Return the engine's orientation after a step that ends with the given spin [rad/s].

    The rotation is the exponential map in `btTransformUtil::integrateTransform`.
    """
    dt, reduced = body.step_s, body.coordinates == "reduced"
    rate = np.sqrt(dot(w, w)) if reduced else _safe_length(w)
    rate = np.where(rate * dt > MAX_TURN_RAD, MAX_TURN_RAD / dt, rate)
    slow = rate < 0.001
    taylor = 0.5 * dt - (dt * dt * dt) * 0.020833333333 * rate * rate
    sine = sin(0.5 * rate * dt) / np.where(slow, 1.0, rate)
    turn = np.vstack((w * np.where(slow, taylor, sine), cos(rate * dt * 0.5)))
    if reduced:  # m_baseQuat is world to body, and its product rounds the other way
        return conjugate(_unit(_product(conjugate(q), conjugate(turn))))
    return _unit(_product(turn, q))


def _fixed(vector: tuple[float, float, float]) -> Float64:
    return np.array(vector)[:, None]


def _unit(q: Float64) -> Float64:
    x, y, z, w = q
    return np.asarray(q * (1.0 / np.sqrt(x * x + y * y + z * z + w * w)))


def conjugate(q: Float64) -> Float64:
    """Return the inverse rotation."""
    return np.array((-q[0], -q[1], -q[2], q[3]))


def _safe_length(a: Float64) -> Float64:
    squared = dot(a, a)
    return np.where(squared > EPSILON, np.sqrt(squared), 0.0)


def _inverted(a: Float64) -> Float64:
    return np.divide(1.0, a, out=np.zeros_like(a), where=a != 0)


def _product(a: Float64, b: Float64) -> Float64:
    return np.array(
        (
            a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
            a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2],
            a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0],
            a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
        )
    )


def _rotated(q: Float64, a: Float64) -> Float64:
    """Rotate vectors by quaternions, as `quatRotate` does."""
    extended = np.vstack((a, np.zeros_like(a[0])))
    return _product(_product(q, extended), conjugate(q))[:3]

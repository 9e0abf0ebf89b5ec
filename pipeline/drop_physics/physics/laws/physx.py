"""PhysX's step of one free body: every operation in float32.

    v' = (v + dt g) max(0, 1 - dt d)        x' = x + dt v'

The spin is first damped and limited to 100 rad/s. Then comes the gyroscopic term, after which the
angular momentum is rescaled to its length before; the temporal Gauss-Seidel solver takes the spin
through the root of the inertia and back. A result below 2^-126 becomes 0. Velocities are the
engine's to the last bit; a changing orientation is within a few units of 2^-23, since sin and cos
are not the engine's. Checked against PhysX 5.3 (SAPIEN 3.0.3) in `tests/test_engines.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64
from drop_physics.physics.base import ORIENTED, Motion
from drop_physics.physics.textbook import TextbookLaw

Single = NDArray[np.float32]
Number = TypeVar("Number", float, Decimal)
Columns = tuple[Single, Single, Single]
F = TypeVar("F", np.float32, np.float64)

DEFAULT_ANGULAR_DAMPING = 0.05
MAX_SPIN_RAD_S = np.float32(100.0)
SMALLEST = np.finfo(np.float32).tiny
SLOW_RAD_S = 1e-15
ONE, TWO, HALF = np.float32(1), np.float32(2), np.float32(0.5)


@dataclass(frozen=True, kw_only=True)
class PhysxLaw(TextbookLaw):
    """A step of PhysX, vectorised over samples."""

    angular_damping: float = DEFAULT_ANGULAR_DAMPING

    epsilon: ClassVar[float] = 2.0**-23
    oriented: ClassVar[float] = ORIENTED * epsilon

    def kept(self, number: Callable[[float], Number]) -> Number:
        """Return the factor by which a step's explicit damping scales a velocity."""
        return max(number(0.0), 1 - number(self.timestep_s) * number(self.linear_damping))

    @property
    def _dt(self) -> np.float32:
        return np.float32(self.timestep_s)

    def released(self, start: Motion) -> Motion:
        """Return a state as the engine stores it."""
        single = (
            getattr(start, name).astype(np.float32).astype(np.float64)
            for name in ("position_m", "orientation", "velocity_m_s", "spin_rad_s")
        )
        return Motion(*single)

    def velocities(self, before: Motion) -> tuple[Float64, Float64]:
        """Return velocity [m/s] and spin [rad/s] after a step, shape (n, 3) each."""
        gravity = np.array(self.gravity_m_s2, dtype=np.float32)
        kept = max(np.float32(0), ONE - np.float32(self.linear_damping) * self._dt)
        velocity_m_s = _flushed(
            (before.velocity_m_s.astype(np.float32) + gravity * self._dt) * kept
        )
        spin = _columns(before.spin_rad_s), before.orientation.astype(np.float32).T
        return velocity_m_s.astype(np.float64), _flushed(_stacked(self._spun(*spin)))

    def _spun(self, spin: Columns, turned: Single) -> Columns:
        dt = self._dt
        kept = max(np.float32(0), ONE - np.float32(self.angular_damping) * dt)
        x, y, z = (part * kept for part in spin)
        squared = x * x + y * y + z * z
        most = MAX_SPIN_RAD_S * MAX_SPIN_RAD_S
        fast = squared > most
        limit = np.where(fast, np.sqrt(most / np.where(fast, squared, ONE)), ONE)
        spin = x * limit, y * limit, z * limit
        inverse = [ONE / np.float32(moment) for moment in self.inertia_kg_m2]
        own = _rotated(turned, spin, back=True)
        momentum = _each([ONE / part for part in inverse], own)
        torque = _cross(own, momentum)
        pushed = _sum(momentum, torque, -dt)
        length, now = _length(momentum), _length(pushed)
        scale = np.where(now > 0, length / np.where(now > 0, now, ONE), np.float32(0))
        x, y, z = pushed
        after = _each(inverse, (x * scale, y * scale, z * scale))
        change = _sum(after, own, -ONE)
        gained = _rotated(turned, change, back=False)
        spin = _sum(spin, gained, ONE)
        # The temporal Gauss-Seidel solver works on √I ω, in the world's axes.
        roots = [np.sqrt(part) for part in inverse]
        axes = _matrix(turned)
        there = _tensor([ONE / root for root in roots], axes)
        return _times(_tensor(roots, axes), _times(there, spin))

    def moved(self, before: Motion, velocity_m_s: Float64, spin_rad_s: Float64) -> Motion:
        """Return each sample moved by one step with these velocities."""
        way_m = velocity_m_s.astype(np.float32) * self._dt
        position_m = _flushed(before.position_m.astype(np.float32) + way_m).astype(np.float64)
        return Motion(position_m, self.turned(before, spin_rad_s), velocity_m_s, spin_rad_s)

    def turned(self, before: Motion, spin_rad_s: Float64) -> Float64:
        """Return the orientations after a step with these spins, shape (n, 4)."""
        spin, turned = _columns(spin_rad_s), before.orientation.astype(np.float32).T
        speed = _length(spin)
        moving = speed > 0
        half = self._dt * speed * HALF
        sine = np.sin(half) / np.where(moving, speed, ONE)
        a, b, c = (part * sine for part in spin)
        d = np.cos(half)
        x, y, z, w = turned
        after = np.stack(
            (
                d * x + a * w + b * z - c * y,
                d * y + b * w + c * x - a * z,
                d * z + c * w + a * y - b * x,
                d * w - a * x - b * y - c * z,
            ),
            axis=1,
        )
        after *= (ONE / np.linalg.norm(after, axis=1))[:, None]
        return np.where(moving[:, None], after, turned.T).astype(np.float64)

    def bits(self, before: Motion) -> Flags:
        """Return from which samples `step` has the engine's velocities to the last bit, (n,).

        Not where the squares of a spin are too small for a float32.
        """
        speed = np.linalg.norm(before.spin_rad_s, axis=1)
        return np.asarray((speed == 0) | (speed > SLOW_RAD_S))

    def terms(self, before: Motion) -> tuple[Float64, Float64]:
        """Return the size of the summands of velocity and spin in a timestep, shape (n,)."""
        v, w = (np.linalg.norm(each, axis=1) for each in (before.velocity_m_s, before.spin_rad_s))
        uneven = max(self.inertia_kg_m2) / min(self.inertia_kg_m2)
        pull = self.timestep_s * float(np.linalg.norm(self.gravity_m_s2))
        return v + pull, w * (1 + self.timestep_s * w * uneven)


def _flushed(numbers: NDArray[F]) -> NDArray[F]:
    """Return numbers with 0 in place of those too small for all digits of a float32."""
    return np.where(np.abs(numbers) < SMALLEST, 0, numbers).astype(numbers.dtype)


def _columns(vectors: Float64) -> Columns:
    x, y, z = vectors.astype(np.float32).T
    return x, y, z


def _stacked(columns: Columns) -> Float64:
    return np.stack(columns, axis=1).astype(np.float64)


def _each(factors: list[np.float32], vector: Columns) -> Columns:
    x, y, z = (factor * part for factor, part in zip(factors, vector, strict=True))
    return x, y, z


def _sum(a: Columns, b: Columns, factor: np.float32) -> Columns:
    """Return a + factor b; with a factor of ±1, a ± b to the last bit."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


def _cross(a: Columns, b: Columns) -> Columns:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _length(vector: Columns) -> Single:
    x, y, z = vector
    squared: Single = x * x + y * y + z * z
    length: Single = np.sqrt(_flushed(squared))
    return length


def _rotated(orientation: Single, vector: Columns, *, back: bool) -> Columns:
    """Rotate vectors by quaternions, or back, as `PxQuat::rotate` and `rotateInv` do."""
    x, y, z, w = orientation
    a, b, c = (TWO * part for part in vector)
    square, along = w * w - HALF, x * a + y * b + z * c
    crossed = (y * c - z * b) * w, (z * a - x * c) * w, (x * b - y * a) * w
    sign = -ONE if back else ONE
    return (
        a * square + sign * crossed[0] + x * along,
        b * square + sign * crossed[1] + y * along,
        c * square + sign * crossed[2] + z * along,
    )


def _matrix(orientation: Single) -> list[Columns]:
    """Return the rows of the rotation matrix, as `PxMat33` computes it from a quaternion."""
    x, y, z, w = orientation
    x2, y2, z2, d = x + x, y + y, z + z, (w + w) * w - ONE
    xw, yw, zw = x2 * w, y2 * w, z2 * w
    return [
        (x * x2 + d, x * y2 - zw, x * z2 + yw),
        (y * x2 + zw, y * y2 + d, y * z2 - xw),
        (z * x2 - yw, z * y2 + xw, z * z2 + d),
    ]


def _tensor(moments: list[np.float32], axes: list[Columns]) -> list[Columns]:
    """Return the rows of R diag(moments) Rᵀ."""

    def entry(i: int, j: int) -> Single:
        low, high = min(i, j), max(i, j)
        a, b, c = (moment * axes[low][k] for k, moment in enumerate(moments))
        total: Single = a * axes[high][0] + b * axes[high][1] + c * axes[high][2]
        return total

    return [(entry(i, 0), entry(i, 1), entry(i, 2)) for i in range(3)]


def _times(rows: list[Columns], vector: Columns) -> Columns:
    a, b, c = vector
    x, y, z = (row[0] * a + row[1] * b + row[2] * c for row in rows)
    return x, y, z

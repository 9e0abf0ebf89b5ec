"""Bullet's integration rule for one rigid body in the air, for many samples at once."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from decimal import Decimal

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.arrays import Vector as Triple
from drop_physics.physics.base import Drag, Law, Motion
from drop_physics.physics.laws.bullet import air as bullet_air
from drop_physics.physics.laws.bullet import spin as bullet_spin
from drop_physics.physics.laws.bullet.air import EPSILON, BulletBody
from drop_physics.physics.vectors import any_of, largest, lengths
from drop_physics.scenario import Coordinates

Columns = tuple[Float64, Float64, Float64, Float64]
"""Position, orientation, velocity and spin, shapes (3, n) and (4, n)."""

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
BLOCK = 4096
"""Number of samples stepped at a time, small enough for the processor's cache."""


def drag_of(k: float, coordinates: Coordinates) -> Drag:
    """Return the continuous-time equivalent of a linear damping.

    Reduced coordinates: k v (1 + |v|) (bullet3 `btMultiBody.cpp` 754-758, 841-843). Maximal ones:
    the effect of v *= (1 - k)^dt per second, for any dt (`btRigidBody.cpp`, `applyDamping`).
    """
    if coordinates == "reduced":
        return Drag(k, k)
    return Drag(-math.log1p(-k) if k < 1 else math.inf, 0.0)


class BulletLaw(BulletBody, Law):
    """The step of PyBullet 3.2.7, vectorised over samples.

    On x86-64, velocities equal the engine's to the last bit for a btRigidBody, and for a
    btMultiBody that neither spins nor is rotated. Otherwise the engine rotates velocities into the
    body's frame and back, by an orientation that is recorded only after a conversion through a
    matrix: then they are within 8 units of 2^-52 of the step's summands (`terms`;
    `tests/test_segments.py`). Where the velocity equals the engine's, so does the position.
    """

    @property
    def drag(self) -> Drag:
        """The damping in continuous time."""
        return drag_of(self.linear_damping, self.coordinates)

    @property
    def moves_exactly(self) -> bool:
        """True if `moved` reproduces the engine's positions to the last bit."""
        return self.substeps == 1

    def step(self, before: Motion) -> Motion:
        """Advance each sample by one timestep."""

        def stepped(x: Float64, q: Float64, v: Float64, w: Float64) -> Columns:
            for _ in range(self.substeps):
                v, w = bullet_spin.velocities(self, v, w, q)
                x, q, v, w = self._moved(x, q, v, w)
            return x, q, v, w

        return _in_blocks(stepped, before)

    def bits(self, before: Motion) -> Flags:
        """Flag the samples from which `step` gives the engine's velocities bit for bit, (n,).

        This is possible only on x86-64. All substeps except the first begin with an orientation
        computed here, not the engine's.
        """
        if self.coordinates == "maximal" and self.substeps == 1:
            return np.ones(len(before), dtype=bool)
        turned = any_of(before.orientation != UPRIGHT)
        return ~(turned | any_of(before.spin_rad_s != 0))

    def terms(self, before: Motion) -> tuple[Float64, Float64]:
        """Return the magnitude of the summands of velocity and spin in a timestep, shape (n,).

        In the body's frame ω × v and ω × Iω are added, and cancel except for rounding.
        """
        dt, inertia = self.timestep_s, self.inertia_kg_m2
        uneven = max(inertia) / min(inertia) if min(inertia) > 0 else 0.0
        v, w = lengths(before.velocity_m_s), lengths(before.spin_rad_s)
        drag, spin_drag = self.linear_damping * (1 + v), self.angular_damping * (1 + w)
        pull = float(np.linalg.norm(self.gravity_m_s2))
        return v + dt * (v * (drag + w) + pull), w + dt * w * (spin_drag + w * uneven)

    def unlimited(self, before: Motion) -> Motion:
        """Advance each sample by one timestep, without the engine's velocity limit."""
        with np.errstate(all="ignore"):  # it may overflow, which the limit prevents
            return replace(self, velocity_limit=math.inf).step(before)

    def limited(self, before: Motion) -> Flags:
        """Flag the timesteps in which a velocity was clamped to the limit, shape (n,)."""
        if self.coordinates == "maximal":
            return np.zeros(len(before), dtype=bool)
        with_it = self.step(before)
        if self.substeps == 1:  # a clamped velocity is exactly the limit
            fastest = largest(np.hstack((with_it.velocity_m_s, with_it.spin_rad_s)))
            if not (fastest >= self.velocity_limit).any():
                return np.zeros(len(before), dtype=bool)
        without = self.unlimited(before)
        fast = with_it.velocity_m_s != without.velocity_m_s
        return any_of(fast | (with_it.spin_rad_s != without.spin_rad_s))

    def turned_by(self, angular_impulse_n_m_s: Float64, before: Motion) -> Float64:  # noqa: ARG002
        """Return the change of spin due to angular impulses [rad/s], in body axes, (n, 3).

        If the inertia about an axis is 0, a btRigidBody does not rotate about this axis, and a
        btMultiBody about no axis at all (`btMultiBody::solveImatrix`).
        """
        inertia = np.array(self.inertia_kg_m2)
        if self.coordinates == "reduced" and inertia.min() < EPSILON:
            return np.zeros_like(angular_impulse_n_m_s)
        turned = np.zeros_like(angular_impulse_n_m_s)
        return np.asarray(np.divide(angular_impulse_n_m_s, inertia, out=turned, where=inertia > 0))

    def moved(self, before: Motion, velocity_m_s: Float64, spin_rad_s: Float64) -> Motion:
        """Move each sample by one integrator step with the given velocities."""
        position_m, orientation = before.position_m, before.orientation
        return _in_blocks(self._moved, Motion(position_m, orientation, velocity_m_s, spin_rad_s))

    def _moved(self, x: Float64, q: Float64, v: Float64, w: Float64) -> Columns:
        return x + v * self.step_s, bullet_spin.turned(self, q, w), v, w

    def free_velocities(self, velocity_m_s: Float64) -> Float64:
        """Return velocities after a step of the integrator [m/s], before `held`.

        Operations are in textbook order, so the result may differ from the engine's in the last
        bits; shape (n, 3).
        """
        pull = np.array(self.gravity_m_s2) * self.step_s
        if self.coordinates == "maximal":
            return np.asarray(velocity_m_s * (1 - self.linear_damping) ** self.step_s + pull)
        speed = np.linalg.norm(velocity_m_s, axis=1, keepdims=True)
        drag = self.step_s * self.linear_damping * velocity_m_s * (1 + speed)
        return np.asarray(velocity_m_s - drag + pull)

    def held(self, velocity_m_s: Float64) -> Float64:
        """Return velocities clamped to the btMultiBody limit [m/s], shape (n, 3)."""
        if self.coordinates == "maximal":
            return velocity_m_s
        return np.clip(velocity_m_s, -self.velocity_limit, self.velocity_limit)

    def exact_path(
        self, position_m: Triple, velocity_m_s: Triple, *, first: int = 0
    ) -> Iterator[Sequence[Decimal]]:
        """Yield the positions of a flight, starting at sample `first`, for `exactly`.

        For a vertical flight, only z is yielded. Spin is ignored: it changes a flight only by
        rounding.
        """
        path = bullet_air.exact_path(self, position_m, velocity_m_s)
        return itertools.islice(path, first * self.substeps, None, self.substeps)


def _in_blocks(change: Callable[..., Columns], motion: Motion) -> Motion:
    """Apply a function to the columns of position, orientation and velocities, in blocks."""
    changed = np.empty((len(motion), 13))
    for first in range(0, len(motion), BLOCK):
        rows = slice(first, first + BLOCK)
        parts = motion.position_m, motion.orientation, motion.velocity_m_s, motion.spin_rad_s
        columns = change(*(np.ascontiguousarray(part[rows].T) for part in parts))
        changed[rows] = np.vstack(columns).T
    return Motion(*np.split(changed, (3, 7, 10), axis=1))

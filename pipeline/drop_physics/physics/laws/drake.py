"""Drake's steps of one free body, discrete and continuous.

Discrete: a = ((m g - c v)/s)/s with s = √(m + dt c) and the force c = m d per speed, to the last
bit, in any orientation; a spin within a few units of 2^-52. The quaternion is moved along ω ⊗ q / 2
and grows; its direction is recorded. Continuous: a Runge-Kutta method with error control, which is
exact where only gravity acts; no law of a step is known for drag and spin. It goes from one rounded
time to the next, so a step is longer or shorter than the timestep by the rounding of both.
Checked against Drake 1.51 in `tests/test_engines.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.physics.base import Motion
from drop_physics.physics.textbook import TextbookLaw, explicit_spin


@dataclass(frozen=True, kw_only=True)
class DrakeLaw(TextbookLaw):
    """A step of Drake; `semi_implicit` is the discrete one."""

    latest_s: float = 0.0
    """Time at the end of the last step [s]."""

    @property
    def clock_s(self) -> float:
        """Largest difference between a step and the timestep [s]."""
        return 0.0 if self.semi_implicit else self.epsilon * self.latest_s

    def covers(self, before: Motion) -> Flags:
        """Return for which samples the engine's law is known to be this one, shape (n,)."""
        if self.semi_implicit:
            return super().covers(before)
        return np.asarray(~before.spin_rad_s.any(axis=1) & (self.linear_damping == 0))

    def velocities(self, before: Motion) -> tuple[Float64, Float64]:
        """Return velocity [m/s] and spin [rad/s] after a step, shape (n, 3) each."""
        dt, drag = self.timestep_s, self.mass_kg * self.linear_damping
        root = math.sqrt(self.mass_kg + dt * drag)
        force_n = self.mass_kg * np.array(self.gravity_m_s2) - drag * before.velocity_m_s
        velocity_m_s = before.velocity_m_s + dt * (force_n / root / root)
        return velocity_m_s, explicit_spin(before, self.inertia_kg_m2, dt)

    def turned(self, before: Motion, spin_rad_s: Float64) -> Float64:
        """Return the orientations after a step with these spins, shape (n, 4)."""
        (x, y, z, w), (a, b, c) = before.orientation.T / 2, spin_rad_s.T
        rate = (
            w * a + z * b - y * c,
            w * b + x * c - z * a,
            w * c + y * a - x * b,
            -x * a - y * b - z * c,
        )
        moved = before.orientation + self.timestep_s * np.stack(rate, axis=1)
        return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True))

    def bits(self, before: Motion) -> Flags:
        """Return from which samples `step` has the engine's velocities to the last bit, (n,)."""
        return np.asarray(~before.spin_rad_s.any(axis=1) & self.semi_implicit)

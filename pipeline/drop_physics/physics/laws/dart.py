"""DART's step of one free body.

A body that falls or rises straight, without spin and in the world's orientation, follows it to the
last bit: a = (m g - c v)(1/(m + dt c)), with the force c = m d per speed. Otherwise a step's
velocities and positions are within a few units of 2^-52 of its summands. DART stores the logarithm
of an orientation, which loses digits: it is read back to 1e-10. Checked against DART 6.20 in
`tests/test_engines.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.physics.base import Motion
from drop_physics.physics.rotations import rotate_inverse
from drop_physics.physics.textbook import (
    UPRIGHT,
    TextbookLaw,
    explicit_spin,
    turned_about,
)


@dataclass(frozen=True, kw_only=True)
class DartLaw(TextbookLaw):
    """A step of DART."""

    oriented: ClassVar[float] = 1e-9

    @property
    def moves_exactly(self) -> bool:
        """Whether `moved` has every position to the last bit: only where `bits` says so."""
        return False

    def velocities(self, before: Motion) -> tuple[Float64, Float64]:
        """Return velocity [m/s] and spin [rad/s] after a step, shape (n, 3) each."""
        dt, drag = self.timestep_s, self.mass_kg * self.linear_damping
        force_n = self.mass_kg * np.array(self.gravity_m_s2) - drag * before.velocity_m_s
        acceleration = force_n * (1 / (self.mass_kg + dt * drag))
        spin_rad_s = explicit_spin(before, self.inertia_kg_m2, dt)
        return before.velocity_m_s + dt * acceleration, spin_rad_s

    def turned(self, before: Motion, spin_rad_s: Float64) -> Float64:
        """Return the orientations after a step with these spins, shape (n, 4)."""
        spin = rotate_inverse(before.orientation, spin_rad_s)
        return turned_about(before.orientation, spin, self.timestep_s)

    def bits(self, before: Motion) -> Flags:
        """Return from which samples `step` has the engine's velocities to the last bit, (n,)."""
        straight = ~before.velocity_m_s[:, :2].any(axis=1) & (not any(self.gravity_m_s2[:2]))
        turned = (before.orientation != UPRIGHT).any(axis=1) | before.spin_rad_s.any(axis=1)
        return np.asarray(straight & ~turned)

"""Energy and angular momentum of a rigid body, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.drop.samples import DropSamples
from drop_physics.engine_report import EngineReport
from drop_physics.physics.base import Motion
from drop_physics.physics.rotations import rotate, rotate_inverse

ROUNDING = 1e-13
"""Share of the summands that may remain, by rounding, in a sum that is exactly 0."""


@dataclass(frozen=True)
class Mechanics:
    """The mechanical state of a body: energies [J] of shape (n,), momentum of shape (n, 3)."""

    kinetic_linear_j: Float64
    kinetic_angular_j: Float64
    potential_j: Float64
    angular_momentum_kg_m2_s: Float64
    """Angular momentum about the centre of mass, world axes."""

    @property
    def total_j(self) -> Float64:
        """Total mechanical energy [J]."""
        return self.kinetic_linear_j + self.kinetic_angular_j + self.potential_j


def mechanics(engine: EngineReport, samples: DropSamples) -> Mechanics:
    """Return energies and angular momentum of a body in uniform gravity, summed over its links.

    The formulas are E = m v²/2 + ω·Iω/2 - m g_z z and L = I ω with I = R diag(I₁, I₂, I₃) Rᵀ.
    Source: Goldstein, *Classical Mechanics*, chapter 5.
    """
    gravity_m_s2 = engine.gravity_m_s2[2]
    inertias_kg_m2 = np.reshape(engine.link_inertias_kg_m2, (-1, 3))
    links: list[Motion] = [samples, *samples.links]
    parts = [
        mechanics_of_part(part, mass_kg, inertia_kg_m2, gravity_m_s2)
        for part, mass_kg, inertia_kg_m2 in zip(
            links, engine.link_masses_kg, inertias_kg_m2, strict=True
        )
    ]
    if len(parts) == 1:
        return parts[0]
    return Mechanics(
        kinetic_linear_j=np.sum([part.kinetic_linear_j for part in parts], axis=0),
        kinetic_angular_j=np.sum([part.kinetic_angular_j for part in parts], axis=0),
        potential_j=np.sum([part.potential_j for part in parts], axis=0),
        angular_momentum_kg_m2_s=_about_centre_of_mass(engine, links, parts),
    )


def mechanics_of_part(
    part: Motion, mass_kg: float, inertia_kg_m2: Float64, gravity_m_s2: float
) -> Mechanics:
    """Return energies and angular momentum of one link; its moments of inertia have shape (3,)."""
    spin_body = rotate_inverse(part.orientation, part.spin_rad_s)
    momentum_body = spin_body * inertia_kg_m2
    return Mechanics(
        kinetic_linear_j=mass_kg / 2 * np.sum(part.velocity_m_s**2, axis=1),
        kinetic_angular_j=np.sum(spin_body * momentum_body, axis=1) / 2,
        potential_j=-mass_kg * gravity_m_s2 * part.position_m[:, 2],
        angular_momentum_kg_m2_s=rotate(part.orientation, momentum_body),
    )


def _about_centre_of_mass(
    engine: EngineReport, rigid: list[Motion], parts: list[Mechanics]
) -> Float64:
    """Return the angular momentum of all links about their common centre of mass.

    Source: L = Σ [I ω + m (x - X) × (v - V)] (Goldstein, section 1.2).
    """
    masses_kg = np.array(engine.link_masses_kg)
    shares = masses_kg / masses_kg.sum()
    centre_m = np.tensordot(shares, [link.position_m for link in rigid], 1)
    drift_m_s = np.tensordot(shares, [link.velocity_m_s for link in rigid], 1)
    total, scale = np.zeros_like(centre_m), np.zeros(len(centre_m))
    for m, link, part in zip(masses_kg, rigid, parts, strict=True):
        arm_m, velocity_m_s = link.position_m - centre_m, link.velocity_m_s - drift_m_s
        total += part.angular_momentum_kg_m2_s + m * np.cross(arm_m, velocity_m_s)
        scale += m * np.abs(arm_m).max(axis=1) * np.abs(link.velocity_m_s).max(axis=1)
    # Differences of equal velocities leave rounding, which is not momentum.
    nothing = np.linalg.norm(total, axis=1) < ROUNDING * scale
    return np.where(nothing[:, None], 0.0, total)


class Drift:
    """Deviation of numbers, shape (n,), or vectors, (n, 3), from the first one."""

    def __init__(self) -> None:
        self._first: Float64 | None = None
        self._most = 0.0

    def add(self, values: Float64) -> None:
        """Add further numbers or vectors."""
        columns = values.reshape(len(values), -1)
        if self._first is None:
            self._first = columns[0].copy()
        away = np.linalg.norm(columns - self._first, axis=1)
        self._most = float(np.maximum(self._most, away.max()))

    @property
    def start(self) -> float:
        """The first number."""
        return 0.0 if self._first is None else float(self._first[0])

    @property
    def relative(self) -> float | None:
        """The largest |x - x(0)| / |x(0)|; None if x(0) is 0 or missing."""
        reference = 0.0 if self._first is None else float(np.linalg.norm(self._first))
        return self._most / reference if reference else None

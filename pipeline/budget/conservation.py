"""Energy and angular momentum of a rigid body, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.budget.case import Case

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Mechanics:
    """The mechanical state of a body: energies [J] of shape (n,), momentum of shape (n, 3)."""

    kinetic_linear_j: Float64
    kinetic_angular_j: Float64
    potential_j: Float64
    angular_momentum_kg_m2_s: Float64
    """About the centre of mass, world axes."""

    @property
    def total_j(self) -> Float64:
        """Total mechanical energy [J]."""
        return self.kinetic_linear_j + self.kinetic_angular_j + self.potential_j


def mechanics(case: Case) -> Mechanics:
    """Return energies and angular momentum of a rigid body in uniform gravity.

    Source: E = m v²/2 + ω·Iω/2 - m g_z z and L = I ω with I = R diag(I₁, I₂, I₃) Rᵀ; any text on
    classical mechanics, for instance Goldstein, chapter 5.
    """
    samples, mass_kg = case.samples, case.engine.mass_kg
    spin_body = rotate_inverse(samples.orientation, samples.spin_rad_s)
    momentum_body = spin_body * np.array(case.engine.inertia_kg_m2)
    return Mechanics(
        kinetic_linear_j=mass_kg / 2 * np.sum(samples.velocity_m_s**2, axis=1),
        kinetic_angular_j=np.sum(spin_body * momentum_body, axis=1) / 2,
        potential_j=-mass_kg * case.fall.gravity_m_s2 * samples.height_m,
        angular_momentum_kg_m2_s=rotate(samples.orientation, momentum_body),
    )


def rotate(orientation: Float64, vectors: Float64) -> Float64:
    """Turn vectors, shape (n, 3), by unit quaternions x, y, z, w, shape (n, 4).

    Source: v + 2 u × (u × v + w v), the vector form of q v q*.
    """
    axis, w = orientation[:, :3], orientation[:, 3:]
    return vectors + 2 * np.cross(axis, np.cross(axis, vectors) + w * vectors)


def rotate_inverse(orientation: Float64, vectors: Float64) -> Float64:
    """Turn vectors back by unit quaternions x, y, z, w; shapes (n, 4) and (n, 3)."""
    return rotate(orientation * [-1, -1, -1, 1], vectors)


def max_relative_drift(values: Float64) -> float | None:
    """Return the largest |x - x(0)| / |x(0)| over samples; None where x(0) = 0.

    `values` holds numbers, shape (n,), or vectors, shape (n, 3).
    """
    columns = values.reshape(len(values), -1)
    if not len(columns):
        return None
    reference = float(np.linalg.norm(columns[0]))
    if reference == 0:
        return None
    return float(np.linalg.norm(columns - columns[0], axis=1).max() / reference)

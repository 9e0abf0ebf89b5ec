"""Where the energy of a fall went: damping, the integrator, rotation, contact.

In the air one step of semi-implicit Euler, v' = v + dt (g + d) and x' = x + dt v' with the drag d,
changes the energy by exactly

    dE = m dt d·(v + v')/2  -  m dt g·(v' - v)/2

The first term is the work of the damping, the second what the integrator loses: it moves the body
with the velocity after the step, but gravity has worked along the mean of both. Derivation: insert
both lines into m v'²/2 - m g·x' minus the same before the step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.budget.conservation import Mechanics
from pipeline.physics.bullet_law import velocities_after_step
from pipeline.physics.theory import Fall

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class EnergyLedger:
    """Change of the mechanical energy over a recording, by cause [J]; `closing_j` is the rest."""

    initial_j: float
    """Of the first sample."""
    final_j: float
    """Of the last sample."""
    damping_j: float
    """Work of the damping."""
    integrator_j: float
    """What semi-implicit Euler loses."""
    rotation_j: float
    """Change of the rotational energy in the air: damping and integration of the spin."""
    contact_j: float
    """What contact takes."""
    closing_j: float
    """What the causes leave unexplained: rounding, unless the state was altered."""


def ledger(
    energies: Mechanics,
    velocity_m_s: Float64,
    fall: Fall,
    *,
    airborne: int,
    timestep_s: float,
    mass_kg: float,
    stepped: bool = True,
) -> EnergyLedger:
    """Book every change of energy to its cause.

    Parameters
    ----------
    energies
        The mechanical state of every sample.
    velocity_m_s
        Linear velocity [m/s], shape (samples, 3).
    fall
        The air and the gravity.
    airborne
        How many samples there are before the first contact. Damping works in every step; what the
        other steps change besides is booked to contact.
    timestep_s, mass_kg
        Timestep [s] and mass [kg].
    stepped
        Whether steps were taken at all: otherwise nothing works, and nothing is lost.
    """
    total_j, spin_j = energies.total_j, energies.kinetic_angular_j
    before = velocity_m_s[:-1]
    after = velocities_after_step(fall, before, timestep_s=timestep_s)
    gravity = np.array([0.0, 0.0, fall.gravity_m_s2])
    drag = after - before - timestep_s * gravity
    damping_j = stepped * mass_kg / 2 * np.sum(drag * (before + after), axis=1)
    integrator_j = -stepped * mass_kg * timestep_s / 2 * ((after - before) @ gravity)
    last = max(airborne - 1, 0)
    in_air_j = float(total_j[last] - total_j[0])
    rotation_j = float(spin_j[last] - spin_j[0])
    booked_in_air_j = float(np.sum(damping_j[:last]) + np.sum(integrator_j[:last])) + rotation_j
    return EnergyLedger(
        initial_j=float(total_j[0]),
        final_j=float(total_j[-1]),
        damping_j=float(np.sum(damping_j)),
        integrator_j=float(np.sum(integrator_j[:last])),
        rotation_j=rotation_j,
        contact_j=float(total_j[-1] - total_j[last]) - float(np.sum(damping_j[last:])),
        closing_j=in_air_j - booked_in_air_j,
    )

"""Where the energy of a fall went: damping, the integrator, rotation, contact.

In the air one step of semi-implicit Euler, v' = v + dt (g + d) and x' = x + dt v' with the drag d,
changes the energy by exactly

    dE = m dt d·(v + v')/2  -  m dt g·(v' - v)/2

The first term is the work of the damping, the second what the integrator loses: it moves the body
with the velocity after the step, but gravity has worked along the mean of both. Derivation: insert
both lines into m v'²/2 - m g·x' minus the same before the step. Where Bullet holds a velocity at
its limit, the change that this makes works like a drag, and is booked for itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.budget.case import Case
from pipeline.budget.conservation import Mechanics
from pipeline.physics.bullet_law import held, velocities_after_step

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class EnergyLedger:
    """Change of the mechanical energy over a recording, by cause [J]; `closing_j` is the rest.

    Of a body with joints there is no ledger of causes.
    """

    initial_j: float
    """Of the first sample."""
    final_j: float
    """Of the last sample."""
    damping_j: float | None = None
    """Work of the damping."""
    integrator_j: float | None = None
    """What semi-implicit Euler loses."""
    clamp_j: float | None = None
    """What Bullet's limit of 100 to each component of the velocity takes, before contact."""
    rotation_j: float | None = None
    """Change of the rotational energy in the air: damping and integration of the spin."""
    contact_j: float | None = None
    """What contact takes."""
    closing_j: float | None = None
    """What the causes leave unexplained: rounding, unless the state was altered."""


def ledger(case: Case, energies: Mechanics, *, airborne: int) -> EnergyLedger:
    """Book every change of energy to its cause.

    Parameters
    ----------
    case
        The drop.
    energies
        The mechanical state of every sample.
    airborne
        How many samples there are before the first contact. Damping works in every step; what the
        other steps change besides is booked to contact.
    """
    total_j, spin_j = energies.total_j, energies.kinetic_angular_j
    if not case.is_rigid:
        return EnergyLedger(initial_j=float(total_j[0]), final_j=float(total_j[-1]))
    damping_j, clamp_j, integrator_j = _work(case)
    last = max(airborne - 1, 0)
    in_air_j = float(total_j[last] - total_j[0])
    rotation_j = float(spin_j[last] - spin_j[0])
    clamped_j = float(np.sum(clamp_j[:last]))
    booked_in_air_j = float(np.sum(damping_j[:last]) + np.sum(integrator_j[:last])) + rotation_j
    return EnergyLedger(
        initial_j=float(total_j[0]),
        final_j=float(total_j[-1]),
        damping_j=float(np.sum(damping_j)),
        integrator_j=float(np.sum(integrator_j[:last])),
        clamp_j=clamped_j,
        rotation_j=rotation_j,
        contact_j=float(total_j[-1] - total_j[last]) - float(np.sum(damping_j[last:])),
        closing_j=in_air_j - (booked_in_air_j + clamped_j),
    )


def _work(case: Case) -> tuple[Float64, Float64, Float64]:
    """Return the work of damping and clamp, and what the integrator loses, in each step [J]."""
    fall, mass_kg, dt = case.fall, case.engine.mass_kg, case.substep_s
    before = case.samples.velocity_m_s[:-1]
    damping_j, clamp_j, integrator_j = np.zeros((3, len(before)))
    if not case.scenario.stepped:  # nothing works, and nothing is lost
        return damping_j, clamp_j, integrator_j
    gravity = np.array([0.0, 0.0, fall.gravity_m_s2])
    for _ in range(case.substeps):
        free = velocities_after_step(fall, before, timestep_s=dt)
        after = held(fall, free)
        drag = free - before - dt * gravity
        damping_j += mass_kg / 2 * np.sum(drag * (before + after), axis=1)
        clamp_j += mass_kg / 2 * np.sum((after - free) * (before + after), axis=1)
        integrator_j -= mass_kg * dt / 2 * ((after - before) @ gravity)
        before = after
    return damping_j, clamp_j, integrator_j

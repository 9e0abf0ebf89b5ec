"""Where the energy of a fall went: damping, the integrator, rotation, contact.

In the air one step of semi-implicit Euler, v' = v + dt (g + d) and x' = x + dt v' with the drag d,
changes the energy by exactly

    dE = m dt d·(v + v')/2  -  m dt g·(v' - v)/2

The first term is the work of the damping, the second what the integrator loses: it moves the body
with the end-of-step velocity, while gravity acts along the mean of both. Derivation: insert both
lines into m v'²/2 - m g·x' minus the same before the step. Where Bullet clamps a velocity to its
limit, the change works like a drag, and is booked separately.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.analysis.drop.case import Case
from pipeline.analysis.general.mechanics import Mechanics

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class EnergyLedger:
    """Change of the mechanical energy over a recording, by cause [J]; `closing_j` is the rest.

    Without a law, as for a body with joints, the causes are None.
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
    """What is lost to Bullet's limit of 100 on each velocity component, before contact."""
    rotation_j: float | None = None
    """Change of the rotational energy in the air: damping and integration of the spin."""
    spin_damping_j: float | None = None
    """Work of the angular damping from the first contact on; before that it is in `rotation_j`."""
    contact_j: float | None = None
    """What contact takes; with `--substeps`, also what damping takes from the first contact on."""
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
        Number of samples before the first contact. Damping works in every step; whatever else
        changes from then on is booked to contact.
    """
    total_j, spin_j = energies.total_j, energies.kinetic_angular_j
    if not case.is_rigid or not case.law.covers(case.samples).all():
        return EnergyLedger(initial_j=float(total_j[0]), final_j=float(total_j[-1]))
    damping_j, clamp_j, integrator_j = _work(case)
    last = max(airborne - 1, 0)
    in_air_j = float(total_j[last] - total_j[0])
    rotation_j = float(spin_j[last] - spin_j[0])
    clamped_j = float(np.sum(clamp_j[:last]))
    if case.substeps > 1:  # what happens within a sample is not recorded
        damping_j[last:] = 0.0
    in_contact_j = float(np.sum(damping_j[last:]))
    spun_j = _spin_damping(case, spin_j[last:-1])
    booked_in_air_j = float(np.sum(damping_j[:last]) + np.sum(integrator_j[:last])) + rotation_j
    return EnergyLedger(
        initial_j=float(total_j[0]),
        final_j=float(total_j[-1]),
        damping_j=float(np.sum(damping_j)),
        integrator_j=float(np.sum(integrator_j[:last])),
        clamp_j=clamped_j,
        rotation_j=rotation_j,
        spin_damping_j=spun_j,
        contact_j=float(total_j[-1] - total_j[last]) - in_contact_j - spun_j,
        closing_j=in_air_j - (booked_in_air_j + clamped_j),
    )


def _work(case: Case) -> tuple[Float64, Float64, Float64]:
    """Return the work of damping and clamp, and what the integrator loses, in each step [J]."""
    law, mass_kg, dt = case.law, case.engine.mass_kg, case.substep_s
    before = case.samples.velocity_m_s[:-1]
    damping_j, clamp_j, integrator_j = np.zeros((3, len(before)))
    if not case.scenario.stepped:
        return damping_j, clamp_j, integrator_j
    gravity = np.array(law.gravity_m_s2)
    for _ in range(case.substeps):
        free = law.free_velocities(before)
        after = law.held(free)
        drag = free - before - dt * gravity
        damping_j += mass_kg / 2 * np.sum(drag * (before + after), axis=1)
        clamp_j += mass_kg / 2 * np.sum((after - free) * (before + after), axis=1)
        if law.semi_implicit:
            integrator_j -= mass_kg * dt / 2 * ((after - before) @ gravity)
        before = after
    return damping_j, clamp_j, integrator_j


def _spin_damping(case: Case, spin_j: Float64) -> float:
    """Return the work of the angular damping in steps that begin with these spin energies [J].

    Less than about a millionth of the energy is left to contact.
    """
    if case.substeps > 1 or not case.scenario.stepped or not len(spin_j):
        return 0.0
    kept = case.law.spin_kept(case.samples.spin_rad_s[-1 - len(spin_j) : -1])
    work_j = float(np.sum(spin_j * (np.square(kept) - 1)))
    return work_j if abs(work_j) > 1e-6 * float(np.abs(spin_j).max() + case.engine.mass_kg) else 0.0

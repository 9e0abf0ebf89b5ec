"""Where the energy of a fall went: damping, the integrator, rotation, contact.

In the air one step of semi-implicit Euler, v' = v + dt (g + d) and x' = x + dt v' with the drag d,
changes the energy by exactly

    dE = m dt d·(v + v')/2  -  m dt g·(v' - v)/2

The first term is the work of the damping, the second what the integrator loses: it moves the body
with the end-of-step velocity, while gravity acts along the mean of both. Derivation: insert both
lines into m v'²/2 - m g·x' minus the same before the step. Where Bullet clamps a velocity to its
limit, the change works like a drag, and is booked separately; so is what the limit takes of a spin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.drop.case import Case
from drop_physics.analysis.general.mechanics import Mechanics, mechanics_of_part
from drop_physics.analysis.general.segments import FLIGHT
from drop_physics.laws.base import Motion
from drop_physics.laws.bullet import BulletLaw

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
    """What semi-implicit Euler loses in flight."""
    clamp_j: float | None = None
    """What is lost in flight to Bullet's limit of 100 on each component of velocity and spin."""
    rotation_j: float | None = None
    """Change of the rotational energy in flight, besides the limit: damping, integration."""
    spin_damping_j: float | None = None
    """Work of the angular damping in contact; in flight it is in `rotation_j`."""
    contact_j: float | None = None
    """What contact takes; with `--substeps`, also what damping takes in contact."""
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
        changes from then on is booked to contact, except in steps that are flight.
    """
    total_j, spin_j = energies.total_j, energies.kinetic_angular_j
    if not case.is_rigid or not case.law.covers(case.samples).all():
        return EnergyLedger(initial_j=float(total_j[0]), final_j=float(total_j[-1]))
    damping_j, clamp_j, integrator_j = _work(case)
    last = max(airborne - 1, 0)
    flies = np.arange(len(damping_j)) < last
    flies[last:] = case.segments.code[last + 1 :] == FLIGHT
    later = flies[last:]  # flights after the first contact
    again_j = float(np.sum(np.diff(total_j[last:])[later]))
    in_air_j = float(total_j[last] - total_j[0]) + again_j
    rotation_j = float(spin_j[last] - spin_j[0]) + float(np.sum(np.diff(spin_j[last:])[later]))
    if case.substeps > 1:  # what happens within a sample is not recorded
        damping_j[~flies] = 0.0
    slowed_j, lost_j = _clamped_spin(case, flies), float(np.sum(integrator_j[flies]))
    clamped_j = float(np.sum(clamp_j[flies])) + slowed_j
    rotation_j -= slowed_j
    in_contact_j, spun_j = float(np.sum(damping_j[~flies])), _spin_damping(case, spin_j, ~flies)
    booked_in_air_j = float(np.sum(damping_j[flies]) + lost_j) + rotation_j
    return EnergyLedger(
        initial_j=float(total_j[0]),
        final_j=float(total_j[-1]),
        damping_j=float(np.sum(damping_j)),
        integrator_j=lost_j,
        clamp_j=clamped_j,
        rotation_j=rotation_j,
        spin_damping_j=spun_j,
        contact_j=float(total_j[-1] - total_j[last]) - again_j - in_contact_j - spun_j,
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


def _clamped_spin(case: Case, flies: NDArray[np.bool_]) -> float:
    """Return what the limit of velocities takes of the spin in the steps in flight [J].

    The energy of a spin does not change in a turn about its own axis, so those of two spins can be
    compared after the step, whatever orientation each led to.
    """
    law, before = case.law, case.samples.at(np.flatnonzero(flies))
    if not isinstance(law, BulletLaw) or not case.scenario.stepped:
        return 0.0
    before = before.at(np.flatnonzero(law.limited(before)))
    substep, taken_j = replace(law, timestep_s=law.step_s, substeps=1), 0.0
    for _ in range(law.substeps if len(before) else 0):
        after, free = substep.step(before), substep.unlimited(before)
        taken_j += float(np.sum(_spin_energy(case, after) - _spin_energy(case, free)))
        before = after
    return taken_j


def _spin_energy(case: Case, motion: Motion) -> Float64:
    """Return the rotational energy of each sample [J], shape (n,)."""
    engine = case.engine
    inertia_kg_m2 = np.array(engine.inertia_kg_m2)
    return mechanics_of_part(motion, engine.mass_kg, inertia_kg_m2, 0.0).kinetic_angular_j


def _spin_damping(case: Case, spin_j: Float64, touches: NDArray[np.bool_]) -> float:
    """Return the work of the angular damping in the steps in contact.

    Less than about a millionth of the energy is left to contact.
    """
    if case.substeps > 1 or not case.scenario.stepped or not touches.any():
        return 0.0
    before_j = spin_j[:-1][touches]
    kept = case.law.spin_kept(case.samples.spin_rad_s[:-1][touches])
    work_j = float(np.sum(before_j * (np.square(kept) - 1)))
    least_j = 1e-6 * float(np.abs(before_j).max() + case.engine.mass_kg)
    return work_j if abs(work_j) > least_j else 0.0

"""Computes the forces that the links of a body exert on each other across joints, in a step."""

from __future__ import annotations

import numpy as np

from drop_physics.explain.steps import BodySteps
from drop_physics.physics.reactions import Reactions, reactions

WITHIN = {
    *("gravity", "bias", "motors", "damping", "joint damping", "spring", "friction loss", "stops"),
    *("joint force range", "contacts", "clamp", "integrator", "solver", "remainder"),
}
"""Causes that do not prevent the computation of reactions: they act only across joints, the force
on each link is known, or they are not forces."""
ROUNDED = 1e-9
"""A remainder below this share of an impulse is rounding."""


def reactions_of(steps: BodySteps, row: int) -> Reactions | None:
    """Return the reactions across a body's joints in one of its steps.

    None if the step is not explained, or if the force of a cause on each link is unknown: an
    applied force in MuJoCo, an equality, a fluid, or a tendon.
    """
    if not steps.covered or not steps.closes[row] or steps.substeps > 1:
        return None
    reported = steps.reported.at(slice(row, row + 1))
    timestep_s = float(reported.timestep_s[0])
    known = {f"actuator {each.name}" for each in steps.body.actuators if each.acts_on == "joint"}
    first = steps.law.tree.first_rate
    for cause, impulse in steps.terms.items():
        left = impulse[row].copy()
        if cause == "applied":
            given = reported.commanded[0] * timestep_s
            left[first:] -= given
            left[np.abs(left) <= ROUNDED * np.abs(given).max(initial=0.0)] = 0.0
        forces = {"applied": reported.applied, "constraints": reported.constraints}.get(cause)
        told = forces is not None and len(forces.link) > 0
        if left.any() and not told and cause not in WITHIN | known:
            return None
    at = np.array([row])
    return reactions(
        steps.law.tree,
        steps.before.at(at),
        steps.after.at(at),
        timestep_s=timestep_s,
        gravity_m_s2=reported.gravity_m_s2[0],
        forces=(reported.contacts, reported.applied, reported.constraints),
    )

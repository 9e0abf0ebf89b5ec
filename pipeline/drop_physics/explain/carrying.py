"""Computes the forces that the links of a body exert on each other across joints, in a step."""

from __future__ import annotations

import numpy as np

from drop_physics.explain.steps import BodySteps
from drop_physics.physics.reactions import Reactions, reactions

WITHIN = {
    *("gravity", "bias", "motors", "damping", "joint damping", "spring", "friction loss", "stops"),
    *("joint force range", "contacts", "clamp", "integrator", "solver", "remainder"),
}
"""Causes that act across a joint alone, or whose forces on each link are known, or that are no
forces."""
ROUNDED = 1e-9
"""Share of an impulse below which the rest of it is rounding."""


def reactions_of(steps: BodySteps, row: int) -> Reactions | None:
    """Return the reactions across a body's joints in one of its steps.

    None where the step is not explained, or where something acts of which the force on each link
    is unknown: a force on a body of MuJoCo, an equality, a fluid, a tendon.
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

"""Computes the forces that the links of a body exert on each other across joints, in a step."""

from __future__ import annotations

import numpy as np

from drop_physics.explain.steps import BodySteps
from drop_physics.physics.moving import moved, way_between
from drop_physics.physics.reactions import Reactions, reactions
from drop_physics.physics.tree import States, Tree

WITHIN = {
    *("gravity", "bias", "motors", "damping", "joint damping", "spring", "friction loss", "stops"),
    *("joint force range", "contacts", "clamp", "integrator", "solver", "remainder"),
}
"""Causes that do not prevent the computation of reactions: they act only across joints, the force
on each link is known, or they are not forces."""
ROUNDED = 1e-9
"""A remainder below this share of an impulse is rounding."""
STRAYED, MOVED_BY = 1e-6, 1e-12
"""Largest difference of a joint from where the velocities at the end of a step lead it: a share of
its way in the step, and a rounding error [rad or m]. In a Runge-Kutta step it is larger."""


def reactions_of(steps: BodySteps, row: int) -> Reactions | None:
    """Return the reactions across a body's joints in one of its steps.

    None if the step is not explained, or if the force of a cause on each link is unknown: an
    applied force in MuJoCo, an equality, a fluid, or a tendon. None for a step of a Runge-Kutta
    method, too: it has no one acceleration.
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
    before, after = steps.before.at(at), steps.after.at(at)
    if _strays(steps.law.tree, before, after, timestep_s):
        return None
    return reactions(
        steps.law.tree,
        before,
        after,
        timestep_s=timestep_s,
        gravity_m_s2=reported.gravity_m_s2[0],
        forces=(reported.contacts, reported.applied, reported.constraints),
    )


def _strays(tree: Tree, before: States, after: States, timestep_s: float) -> bool:
    """Return whether joints are not where the velocities at the end of a step lead them."""
    reached = moved(tree, before, after.velocity, np.array([timestep_s]), np.inf)
    off, way = (
        np.abs(way_between(tree, *ends))[0, tree.first_rate :].max(initial=0.0)
        for ends in ((reached, after), (before, after))
    )
    return bool(off > STRAYED * way + MOVED_BY)

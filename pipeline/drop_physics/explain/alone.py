"""Explains single rigid bodies by a separate law where the sum for trees does not apply.

A btRigidBody follows a different law than a tree, and for a timestep of several substeps PyBullet
reports only the contacts of the last substep. Flight is then checked against the law of free fall,
and contact against the balance of impulses, where that is defined (`segments`).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from drop_physics.arrays import Flags, Float64, Int8
from drop_physics.explain import segments
from drop_physics.explain.balance import Pushes
from drop_physics.explain.bodies import BodyConfig
from drop_physics.explain.touching import Touches
from drop_physics.physics.base import Law, Motion
from drop_physics.physics.impulses import Forces
from drop_physics.physics.step_law import Reason, Reported
from drop_physics.physics.tree import States
from drop_physics.physics.vectors import lengths, summed

ALONE: frozenset[Reason] = frozenset(("engine", "substeps", "maximal", "massless"))
"""Reasons for which the sum does not cover a body, while the law of a single body may."""


def motion_of(states: States) -> Motion:
    """Return the motion of the base of a movable body."""
    turning, moving = states.velocity[:, :3], states.velocity[:, 3:6]
    return Motion(
        *map(np.ascontiguousarray, (states.position_m, states.orientation, moving, turning))
    )


def law_of(config: BodyConfig, timestep_s: float, gravity_m_s2: Float64) -> Law | None:
    """Return the free-flight integration rule for a body without links; None if none applies.

    `gravity_m_s2` has the shape (3,).
    """
    tree, mass_kg = config.law.tree, float(config.law.tree.masses_kg[0])
    if tree.fixed or tree.links or not (mass_kg > 0 and np.isfinite(1 / mass_kg)):
        return None
    if config.other is not None or config.step_law is None:
        return config.other
    return config.step_law.flight(
        config.law,
        maximal="maximal" in config.reasons,
        substeps=config.substeps,
        damping=config.damping,
        timestep_s=timestep_s,
        gravity_m_s2=gravity_m_s2,
    )


def explained(
    config: BodyConfig,
    before: States,
    after: States,
    reported: Reported,
    touches: Touches,
    *,
    exact: bool,
) -> Int8:
    """Classify each step by the single-body law: flight, contact … or unexplained, (n,).

    The codes are those of `segments`. `exact` is whether the machine rounds each operation once.
    """
    codes = np.full(len(before), segments.UNEXPLAINED, np.int8)
    timestep_s, gravity_m_s2 = reported.timestep_s, reported.gravity_m_s2
    changed = (np.diff(timestep_s) != 0) | (np.diff(gravity_m_s2, axis=0) != 0).any(axis=1)
    bounds = [0, *(np.flatnonzero(changed) + 1).tolist(), len(before)]
    for first, end in pairwise(bounds):
        law = law_of(config, float(timestep_s[first]), gravity_m_s2[first])
        if law is None or end == first:
            continue
        rows = slice(first, end)
        points = slice(*np.searchsorted(touches.step, [first, end]))
        then = motion_of(before).at(rows)
        found = segments.segments_of(
            motion_of(after).at(rows),
            law,
            touches.since(first, points),
            exact=exact,
            pushes=_pushes(reported.applied.between(first, end), then),
            placed=np.zeros(end - first, np.bool_),
            before=then,
            rolls=_rolling(reported.contacts.between(first, end), end - first),
        )
        codes[rows] = found.code
    return codes


def _rolling(contacts: Forces, steps: int) -> Flags:
    """Flag steps in which rolling friction may have exerted an unreported torque."""
    rolls = np.zeros(steps, np.bool_)
    rolls[contacts.step[contacts.rolling]] = True
    return rolls


def _pushes(applied: Forces, before: Motion) -> Pushes | None:
    """Return forces and torques applied by calls, about the centre of mass; None without any."""
    if not len(applied):
        return None
    n, step = len(before), applied.step
    arm_m = applied.point_m - before.position_m[step]
    torque_n_m = applied.torque_n_m + np.cross(arm_m, applied.force_n)
    force, torque = (lengths(each) for each in (applied.force_n, applied.torque_n_m))
    reach = lengths(applied.point_m) + lengths(before.position_m[step])
    return Pushes(
        summed(step, applied.force_n, count=n),
        summed(step, torque_n_m, count=n),
        summed(step, force[:, None], count=n)[:, 0],
        summed(step, (torque + force * reach)[:, None], count=n)[:, 0],
    )

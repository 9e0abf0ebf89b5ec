"""Bullet's integration rule for a tree, as the analysis calls it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.physics.impulses import Summed
from drop_physics.physics.laws.bullet.air import (
    EPSILON,
    MAX_COORDINATE_VELOCITY_M_S,
    effective_damping,
)
from drop_physics.physics.laws.bullet.law import BulletLaw
from drop_physics.physics.laws.bullet.reports import constraint_forces, gear_impulses
from drop_physics.physics.laws.bullet.spin import MAX_TURN_RAD
from drop_physics.physics.laws.bullet.substeps import sum_of_substeps
from drop_physics.physics.laws.bullet.tree import DAMPING, not_covered, sum_of
from drop_physics.physics.step_law import DampedTree, Reported, StepLaw
from drop_physics.physics.tree import States
from drop_physics.physics.vectors import triple
from drop_physics.scenario import Coordinates


def steps_of(
    body: DampedTree,
    states: States,
    reported: Reported,
    substeps: int,
    servos: Callable[[States], Float64],
) -> tuple[Summed, Float64]:
    """Return n steps as sums of impulses, and the efforts of PD_CONTROL in their last substeps.

    `servos` returns the efforts of PD_CONTROL in given states, shape (n, joint_rates).
    """
    if substeps > 1:
        return sum_of_substeps(body, states, reported, substeps, servos)
    return sum_of(body, states, reported).summed(fixed=body.tree.fixed), reported.pd


def flight(
    body: DampedTree,
    *,
    maximal: bool,
    substeps: int,
    damping: tuple[float | None, float | None],
    timestep_s: float,
    gravity_m_s2: Float64,
) -> BulletLaw | None:
    """Return the law of free flight for a body without links; None if the engine cannot step it.

    `damping` is the linear and angular damping set by calls; `gravity_m_s2` has the shape (3,).
    """
    if not EPSILON <= timestep_s < np.inf:
        return None
    coordinates: Coordinates = "maximal" if maximal else "reduced"
    linear, angular = (effective_damping(each, coordinates) for each in damping)
    return BulletLaw(
        timestep_s=timestep_s,
        substeps=substeps,
        gravity_m_s2=triple(gravity_m_s2),
        mass_kg=float(body.tree.masses_kg[0]),
        inertia_kg_m2=triple(body.tree.inertias_kg_m2[0]),
        linear_damping=linear,
        angular_damping=angular,
        coordinates=coordinates,
        velocity_limit=body.velocity_limit,
    )


BULLET = StepLaw(
    damping=DAMPING,
    velocity_limit=MAX_COORDINATE_VELOCITY_M_S,
    least_timestep_s=EPSILON,
    most_turn_rad=MAX_TURN_RAD,
    not_covered=not_covered,
    sum_of=steps_of,
    flight=flight,
    constraint_forces=constraint_forces,
    gear_impulses=gear_impulses,
)

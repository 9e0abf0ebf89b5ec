"""Converts PyBullet's constraint reports to forces on links and efforts on joints.

Axes, points of action and signs follow PyBullet's sources (file names and line numbers refer to
bullet3), and were measured with PyBullet 3.2.7 (`docs/validation.md`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.physics.impulses import Forces
from drop_physics.physics.kinematics import Kinematics
from drop_physics.physics.tree import Tree


def constraint_forces(
    kin: Kinematics,
    *,
    kind: Literal["fixed", "point2point"],
    as_parent: bool,
    link: int,
    pivot_m: Sequence[float],
    axes: Float64,
    reported: Float64,
) -> Forces:
    """Return the forces exerted by a `createConstraint` constraint on one of its bodies, n rows.

    `pivot_m` is the pivot point on this body, in the link's axes; `axes` the rotation from the
    parent's frame to the world, shape (n, 3, 3); `reported` the numbers of `getConstraintState`
    after each step, (n, 6) or (n, 3): forces along the world's axes, then torques about the axes of
    the parent's frame (`btMultiBodyFixedConstraint.cpp` 150-183, `btMultiBodyPoint2Point.cpp` 120,
    where the axes are negative).
    """
    sign = 1.0 if as_parent == (kind == "fixed") else -1.0
    steps = np.arange(len(reported))
    torque = np.zeros((len(steps), 3))
    if kind == "fixed":
        torque = np.einsum("nij,nj->ni", axes, reported[:, 3:6])
    return Forces(
        step=steps,
        link=np.full(len(steps), link),
        force_n=sign * reported[:, :3],
        point_m=kin.point_m(link, pivot_m)[: len(steps)],
        torque_n_m=sign * torque,
        rolling=np.zeros(len(steps), np.bool_),
    )


def gear_impulses(
    tree: Tree, *, as_parent: bool, link: int, ratio: float, reported: Float64, timestep_s: Float64
) -> Float64:
    """Return the impulses of a JOINT_GEAR constraint on one of its joints, shape (n, joint_rates).

    `reported` is the one number of `getConstraintState` after each step, shape (n,): the effort on
    the parent's joint or, multiplied by the gear ratio, on the child's joint
    (`btMultiBodyGearConstraint.cpp` 98-106).
    """
    impulses = np.zeros((len(reported), tree.joint_rates))
    acting = reported * timestep_s * (1.0 if as_parent else ratio)
    impulses[:, tree.rates[link].start - tree.first_rate] = acting
    return impulses

"""Computes the reaction forces and torques at a tree's joints from the motion of its links.

Newton's and Euler's laws for a joint's link and all its descendants, with momenta p and angular
momenta L about the centres c, in a step of duration h:

    F = Σ Δp / h - Σ m g - Σ f
    T = Σ ΔL / h + Σ (c - o) × (Δp / h - m g) - Σ (x - o) × f - Σ τ

where f and τ are the other forces and torques on these links, f at x, and o is a point on the
joint's axis. Source: Featherstone, *Rigid Body Dynamics Algorithms* (2008), section 5.3, with
momenta in place of accelerations.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.physics.dynamics import angular_momenta
from drop_physics.physics.impulses import Forces
from drop_physics.physics.kinematics import kinematics, motion
from drop_physics.physics.tree import BASE, States, Tree


@dataclass(frozen=True, eq=False)
class Reactions:
    """Forces and torques by parents on links, at the joints, in world axes, (links, 3) each."""

    force_n: Float64
    torque_n_m: Float64
    """Torque about a point on the joint's axis, including the torque of the joint's motor."""


def reactions(
    tree: Tree,
    before: States,
    after: States,
    *,
    timestep_s: float,
    gravity_m_s2: Float64,
    forces: Iterable[Forces],
) -> Reactions:
    """Return the reactions in one step, given the state before and after it.

    `gravity_m_s2` has the shape (3,); `forces` are all other forces on single links in the step.
    """
    here, there = kinematics(tree, before), kinematics(tree, after)
    motions = motion(here, before.velocity), motion(there, after.velocity)
    spun = [angular_momenta(kin, moved) for kin, moved in zip((here, there), motions, strict=True)]
    force_n, torque_n_m = np.zeros((2, tree.links + 1, 3))
    for link in tree.moving:
        gained = motions[1].velocities[link + 1] - motions[0].velocities[link + 1]
        its = tree.masses_kg[link + 1] * (gained[:, 0] / timestep_s - gravity_m_s2)
        force_n[link + 1] = its
        torque_n_m[link + 1] = (spun[1][link] - spun[0][link])[:, 0] / timestep_s
    for each in forces:
        for link, its, point_m, torque in zip(
            each.link.tolist(), each.force_n, each.point_m, each.torque_n_m, strict=True
        ):
            force_n[link + 1] -= its
            torque_n_m[link + 1] -= np.cross(point_m - here.position_m(link)[0], its) + torque
    about_joint = np.zeros((tree.links, 3))
    for link in reversed(range(tree.links)):
        parent, centre, its = tree.parents[link], here.position_m(link)[0], force_n[link + 1]
        about_joint[link] = torque_n_m[link + 1] + np.cross(centre - here.pivots[link][:, 0], its)
        if parent != BASE:
            arm_m = centre - here.position_m(parent)[0]
            torque_n_m[parent + 1] += torque_n_m[link + 1] + np.cross(arm_m, its)
            force_n[parent + 1] += its
    return Reactions(force_n[1:], about_joint)

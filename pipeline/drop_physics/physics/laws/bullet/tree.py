"""Bullet's step of a btMultiBody: the engine's own terms, and the forces that it reports.

In `Reported`, `motors` are `appliedJointMotorTorque` after each step, `commanded` the sum of
efforts by TORQUE_CONTROL, `pd` the efforts of PD_CONTROL, which `getJointState` reports as 0.
Contacts are those of `getContactPoints`, constraints those of `getConstraintState`, after each
step.

Measured with PyBullet 3.2.7 (`docs/validation.md`). File names and line numbers refer to bullet3.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.physics.columns import length
from drop_physics.physics.dynamics import angular_momenta, bias, gravity, lifted_j, mass_matrix
from drop_physics.physics.impulses import (
    Sum,
    change_of,
    impulses_of,
    largest_per_step,
    per_step,
)
from drop_physics.physics.kinematics import (
    Kinematics,
    LinkVelocities,
    generalised,
    kinematics,
    motion,
)
from drop_physics.physics.laws.bullet.air import DEFAULT_DAMPING, EPSILON
from drop_physics.physics.step_law import DampedTree, Reason, Reported, StepConditions
from drop_physics.physics.tree import States, Tree
from drop_physics.physics.unreported import Unreported, shared_out

DAMPING = DEFAULT_DAMPING["reduced"]
"""Default linear and angular damping of links."""


# -- the sum --------------------------------------------------------------------------------------


def sum_of(body: DampedTree, states: States, reported: Reported) -> Sum:
    """Return n steps as a sum of impulses, from the n + 1 states around them.

    Memory grows with n: divide long recordings into chunks, each beginning with the last state of
    the previous one. If a state is not finite, the remainder is not finite either.

    Raises
    ------
    numpy.linalg.LinAlgError
        If M has no inverse (`massless`).
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return _sum_of(body, states, reported)


def _sum_of(body: DampedTree, states: States, reported: Reported) -> Sum:
    tree = body.tree
    everywhere = kinematics(tree, states)
    matrices, before = mass_matrix(everywhere), everywhere.at(slice(0, len(states) - 1))
    dt = reported.timestep_s
    terms = known_terms(body, before, matrices[:-1], states.velocity[:-1], reported)
    left = change_of(matrices, states.velocity) - sum(terms.values())
    found = shared_out(left, matrices[:-1], before, _unreported(body, states, reported))
    terms["clamp"] = terms["clamp"] + found.clamp
    terms |= {"rolling": found.rolling, "stops": found.stops}
    lifted = lifted_j(everywhere, reported.gravity_m_s2)
    every = reported.contacts.then(reported.applied).then(reported.constraints)
    largest = largest_per_step(tree, every, reported.gravity_m_s2, dt)
    return Sum(matrices, states.velocity, terms, found.remainder, lifted, largest)


def known_terms(
    body: DampedTree, kin: Kinematics, matrices: Float64, velocity: Float64, reported: Reported
) -> dict[str, Float64]:
    """Return the impulses of all known or reported causes, shape (n, size) each."""
    tree, dt = body.tree, reported.timestep_s
    terms = _free_terms(body, kin, velocity, reported)
    pd = _on_joints(tree, reported.pd * dt[:, None])
    terms["clamp"] = _clamped(body, matrices, velocity, terms, pd)
    terms["motors"] = pd + _on_joints(tree, reported.motors * dt[:, None])
    for name, forces in (("contacts", reported.contacts), ("constraints", reported.constraints)):
        terms[name] = per_step(forces, impulses_of(kin, forces, dt), steps=len(kin))
    if reported.geared is not None:
        terms["constraints"] = terms["constraints"] + _on_joints(tree, reported.geared)
    return terms


def _free_terms(
    body: DampedTree, kin: Kinematics, velocity: Float64, reported: Reported
) -> dict[str, Float64]:
    """Return the terms that act before the solver, without PD_CONTROL."""
    tree, dt = body.tree, reported.timestep_s[:, None]
    moved = motion(kin, velocity)
    damped = velocity[:, tree.first_rate :] if reported.damped is None else reported.damped
    joint_damping = -body.joint_damping * damped
    pushes = per_step(
        reported.applied, impulses_of(kin, reported.applied, reported.timestep_s), steps=len(kin)
    )
    return {
        "gravity": dt * gravity(kin, reported.gravity_m_s2),
        "bias": dt * bias(kin, moved, velocity),
        "damping": dt * damping(body, kin, moved),
        "joint damping": dt * _on_joints(tree, joint_damping),
        "applied": pushes + dt * _on_joints(tree, reported.commanded),
    }


def damping(body: DampedTree, kin: Kinematics, moved: LinkVelocities) -> Float64:
    """Return the generalised force due to Bullet's damping, shape (n, size).

    The force on each link is -m v (k + k |v|), the torque -I ω (k' + k' |ω|) (`btMultiBody.cpp`
    754-758, 841-843).
    """
    tree, k, turning = kin.tree, body.linear_damping, body.angular_damping
    forces = (
        {
            link: moved.velocities[link + 1]
            * (-tree.masses_kg[link + 1] * k * (1.0 + length(moved.velocities[link + 1])))
            for link in tree.moving
        }
        if k
        else {}
    )
    torques = (
        {
            link: momentum * (-turning * (1.0 + length(moved.spins[link + 1])))
            for link, momentum in angular_momenta(kin, moved).items()
        }
        if turning
        else {}
    )
    return generalised(kin, forces, torques)


def _clamped(
    body: DampedTree,
    matrices: Float64,
    velocity: Float64,
    terms: Mapping[str, Float64],
    pd: Float64,
) -> Float64:
    """Return the impulse of the velocity clamp before the solver: M (clip(free) - free), (n, size).

    Bullet clamps each entry of u after forces were added, before motors and contacts
    (`btMultiBody.h` 483-487).
    """
    force = sum(terms.values()) + pd
    free = velocity + np.linalg.solve(matrices, force[:, :, None])[:, :, 0]
    beyond = np.clip(free, -body.velocity_limit, body.velocity_limit) - free
    if not beyond.any():
        return np.zeros_like(free)
    return np.asarray((matrices @ beyond[:, :, None])[:, :, 0])


def _on_joints(tree: Tree, efforts: Float64) -> Float64:
    """Convert joint efforts, (n, joint_rates), to generalised forces, (n, size)."""
    out = np.zeros((len(efforts), tree.size))
    out[:, tree.first_rate :] = efforts
    return out


def _unreported(body: DampedTree, states: States, reported: Reported) -> Unreported:
    """Return the directions of impulses that Bullet never reports: stops, last clamp, rolling."""
    tree = body.tree
    pushes = np.zeros((len(states) - 1, tree.size), np.int64)
    for link, joint in enumerate(tree.joints):
        at, rate = tree.coordinates[link], tree.rates[link]
        lower, upper = (
            limits[rate.start - tree.first_rate : rate.stop - tree.first_rate]
            for limits in (body.lower, body.upper)
        )
        if joint in ("revolute", "prismatic") and lower[0] <= upper[0]:
            q = states.joints[:-1, at.start]
            pushes[q <= lower[0], rate.start] |= Unreported.UP
            pushes[q >= upper[0], rate.start] |= Unreported.DOWN
        elif joint == "spherical" and min(lower[0], upper[0]) > 0:  # `URDF2Bullet.cpp` 434
            pushes[:, rate] = Unreported.UP | Unreported.DOWN
    clamped = np.abs(states.velocity[1:]) >= body.velocity_limit
    rows = reported.contacts.rolling
    return Unreported(pushes, clamped, reported.contacts.step[rows], reported.contacts.link[rows])


# -- where the sum does not hold ------------------------------------------------------------------


def not_covered(settings: StepConditions, tree: Tree | None = None) -> tuple[Reason, ...]:
    """Return the reasons, known from the settings, why a body's step may not equal the sum.

    - engine: another engine's step is not this sum; its law of one body in flight may be known.
    - substeps (`numSubSteps`): only the last substep's motors and contacts are reported.
    - asleep (`activationState`): a sleeping body is not stepped, whatever acts on it.
    - maximal (`useMaximalCoordinates`): a btRigidBody, whose law is `bullet`.
    - massless: something can move that has neither mass nor inertia, so M has no inverse; Bullet
      leaves a free body without mass or without some moment of inertia at the spin that it has.
    - planar: two of the three numbers of a planar joint are reported.

    Reasons that settings alone do not show are given for single steps:

    - soft: a soft body is near, which is no tree.
    - constraint: the force of a prismatic constraint is reported along axes that are not.
    - rolling unreported: with `enableConeFriction=0` the torque against rolling is reported in
      place of sliding friction.
    """
    reasons: dict[Reason, bool] = {
        "engine": settings.other_engine,
        "substeps": settings.substeps > 1,
        "asleep": settings.may_sleep,
        "maximal": settings.maximal,
        "massless": tree is not None and massless(tree),
        "planar": settings.planar,
    }
    return tuple(reason for reason, holds in reasons.items() if holds)


def massless(tree: Tree) -> bool:
    """Return whether a movable link has neither mass nor, where it rotates, inertia.

    This is evaluated with all joints at 0. For Bullet, an inertia below EPSILON is 0
    (`btMultiBody::solveImatrix`).
    """
    q = np.zeros((1, tree.joint_coordinates))
    for link, at in enumerate(tree.coordinates):
        if tree.joints[link] == "spherical":
            q[0, at.stop - 1] = 1.0
    still = States(np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]), q, np.zeros((1, tree.size)))
    (matrix,) = mass_matrix(kinematics(tree, still))
    least = np.diagonal(matrix)
    if not tree.size or (least < EPSILON).any():
        return bool(tree.size)
    if not np.isfinite(matrix).all():  # a mass or inertia that is no number
        return False
    scaled = matrix / np.sqrt(np.outer(least, least))
    return bool(np.linalg.eigvalsh(scaled)[0] < tree.size * EPSILON)

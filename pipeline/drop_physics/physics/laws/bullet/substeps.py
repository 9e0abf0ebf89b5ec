"""Bullet's step of a tree in several substeps (`numSubSteps`), only the last of which is reported.

    each substep     M (u' - u) = dt/N (gravity + bias + damping + joint damping + applied)
                                  + motors + contacts + constraints        q' = q + dt/N q̇'

Constant over all substeps are gravity, the forces and torques of calls, in world axes, and the
force of joint damping, which PyBullet computes once, from the rates before the step. The effort of
PD_CONTROL is added in each substep and removed only after the last, so that k efforts act in the
k-th substep. In each substep, a motor may exert its force limit times the whole timestep. Sources:
`PhysicsServerCommandProcessor.cpp` 10565-10592, `btDiscreteDynamicsWorld::stepSimulation`,
`pdControlPlugin.cpp`; measured with PyBullet 3.2.7 (`docs/validation.md`).

Motors, contacts and constraints are reported for the last substep only. The other substeps are
known if none of these act, or if each exerts the same impulse in every substep: a motor that holds
a pose or is at its limit, a body at rest on a floor. This assumption is checked at the end of the
step: the substeps must lead to the recorded velocity and pose.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import reduce
from typing import Any

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.impulses import EXPLAINED, Forces, Sum, Summed
from drop_physics.physics.kinematics import Kinematics, kinematics
from drop_physics.physics.laws.bullet.spin import MAX_TURN_RAD
from drop_physics.physics.laws.bullet.tree import known_terms, sum_of
from drop_physics.physics.moving import moved, moved_on, way_between
from drop_physics.physics.step_law import DampedTree, Reported
from drop_physics.physics.tree import States

HELD = 1e-6
"""Maximum difference, as a share of the largest term, between impulses that are assumed equal in
all substeps; they are not exactly equal, since the solver stops earlier. Measured: 2e-8 for a
resting body."""


def sum_of_substeps(
    body: DampedTree,
    states: States,
    reported: Reported,
    substeps: int,
    servos: Callable[[States], Float64],
) -> tuple[Summed, Float64]:
    """Return n steps, each of `substeps` substeps, as sums, from the n + 1 states around them.

    Also returns the efforts of PD_CONTROL in the last substep of each step, shape (n, joint_rates).

    `reported` contains the forces of motors and contacts in the last substep; `servos` returns the
    efforts of PD_CONTROL in given states, shape (n, joint_rates).

    Raises
    ------
    numpy.linalg.LinAlgError
        If M has no inverse (`massless`).
    """
    count = len(states) - 1
    before, after = states.at(slice(0, count)), states.at(slice(1, None))
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        begins, given = _substeps(body, before, reported, substeps, servos)
        chain = _in_turn(begins).then(after.at(slice(count - 1, None)))
        found = sum_of(body, chain, _reports_in_turn(given))
        return _summed(body, found, begins[-1], after, given[-1]), given[-1].pd


def _substeps(
    body: DampedTree,
    before: States,
    reported: Reported,
    substeps: int,
    servos: Callable[[States], Float64],
) -> tuple[list[States], list[Reported]]:
    """Return the states before all substeps, and the forces known for each substep."""
    tree = body.tree
    one = replace(
        reported,
        timestep_s=reported.timestep_s / substeps,
        geared=None if reported.geared is None else reported.geared / substeps,
        damped=before.velocity[:, tree.first_rate :],
    )
    first, now, effort = kinematics(tree, before), before, np.zeros_like(reported.pd)
    begins, given = [], []
    for number in range(substeps):
        kin = kinematics(tree, now)
        effort = effort + servos(now)
        here = replace(one, pd=effort, applied=_carried(one.applied, first, kin))
        begins.append(now)
        given.append(here)
        if number < substeps - 1:
            now = _next(body, kin, now, here)
    return begins, given


def _next(body: DampedTree, kin: Kinematics, now: States, reported: Reported) -> States:
    """Return the states after one substep."""
    matrices = mass_matrix(kin)
    impulse = sum(known_terms(body, kin, matrices, now.velocity, reported).values())
    velocity = now.velocity + np.linalg.solve(matrices, np.asarray(impulse)[:, :, None])[:, :, 0]
    held = np.clip(velocity, -body.velocity_limit, body.velocity_limit)
    return moved(body.tree, now, held, reported.timestep_s, MAX_TURN_RAD)


def _carried(forces: Forces, first: Kinematics, now: Kinematics) -> Forces:
    """Move forces along with the centres of their links since the start of the step."""
    if not len(forces):
        return forces
    points = forces.point_m.copy()
    for link in np.unique(forces.link).tolist():
        rows = forces.link == link
        way = now.position_m(link) - first.position_m(link)
        points[rows] += way[forces.step[rows]]
    return replace(forces, point_m=points)


# -- all substeps in turn --------------------------------------------------------------------------


def _in_turn(begins: Sequence[States]) -> States:
    """Interleave the states of all substeps in chronological order."""
    names = [column.name for column in fields(States)]
    return States(*(_woven([getattr(begin, name) for begin in begins]) for name in names))


def _reports_in_turn(given: Sequence[Reported]) -> Reported:
    """Interleave the known forces of all substeps in chronological order."""
    joined: dict[str, Any] = {}
    for name in [column.name for column in fields(Reported)]:
        columns = [getattr(each, name) for each in given]
        if isinstance(columns[0], np.ndarray):
            joined[name] = _woven(columns)
        elif isinstance(columns[0], Forces):
            turns = [
                replace(each, step=each.step * len(given) + number)
                for number, each in enumerate(columns)
            ]
            joined[name] = reduce(Forces.then, turns)
    return replace(given[0], **joined)


def _woven(columns: Sequence[Float64]) -> Float64:
    stacked = np.stack(columns, axis=1)
    return stacked.reshape(len(stacked) * len(columns), *stacked.shape[2:])


def _summed(
    body: DampedTree, found: Sum, last: States, after: States, reported: Reported
) -> Summed:
    """Add up the substeps of each step, the last of which starts at `last`."""
    tree, count, dt = body.tree, len(after), reported.timestep_s
    substeps = len(found.remainder) // max(count, 1)

    def whole(values: Float64) -> Float64:
        return np.asarray(values.reshape(count, substeps, *values.shape[1:]).sum(axis=1))

    def causes(values: Mapping[str, Float64]) -> dict[str, Float64]:
        return {name: whole(each) for name, each in values.items()}

    remainder, largest = whole(found.remainder), whole(found.largest)
    reached = moved(tree, last, after.velocity, dt, MAX_TURN_RAD)
    missed = way_between(tree, reached, after) / dt[:, None]
    missed[moved_on(tree, last, after, dt, MAX_TURN_RAD)] = 0.0
    matrices = found.matrix.reshape(count, substeps, tree.size, tree.size)[:, -1]
    aside = (matrices @ missed[:, :, None])[:, :, 0]
    left = np.abs(np.hstack((remainder, aside))).max(axis=1)
    held = np.asarray(reported.motors.any(axis=1))
    if reported.geared is not None:
        held = held | reported.geared.any(axis=1)
    for forces in (reported.contacts, reported.constraints):
        acts = forces.force_n.any(axis=1) | forces.torque_n_m.any(axis=1)
        held[forces.step[acts]] = True
    one = found.summed(fixed=tree.fixed)
    return Summed(
        terms=causes(one.terms),
        remainder=remainder,
        largest=largest,
        unexplained=np.divide(
            left, largest, out=np.where(left == 0, 0.0, np.inf), where=largest > 0
        ),
        allowed=np.where(held, HELD, EXPLAINED),
        energy_j=causes(one.energy_j),
        changed_j=whole(one.changed_j),
        momentum_kg_m_s=causes(one.momentum_kg_m_s),
        moved_kg_m_s=whole(one.moved_kg_m_s),
    )

"""Bullet's step of a tree in several substeps (`numSubSteps`), of which it reports the last.

    each substep     M (u' - u) = dt/N (gravity + bias + damping + joint damping + applied)
                                  + motors + contacts + constraints        q' = q + dt/N q̇'

Held over all substeps are gravity, the forces and torques of calls, in the world's axes, and the
force of joint damping, which PyBullet takes once, from the rates before the step. PD_CONTROL is
added in each substep and taken away after the last, so that the k-th substep has k of them. A
motor may give force × the whole timestep in each. Sources: `PhysicsServerCommandProcessor.cpp`
10565-10592, `btDiscreteDynamicsWorld::stepSimulation`, `pdControlPlugin.cpp`; measured with
PyBullet 3.2.7 (`docs/validation.md`).

Motors, contacts and constraints are reported as they were in the last substep. So the others are
known where nothing of these acts; and where they give the same impulse in each: a motor that holds
a pose or is at its limit, what rests on a floor. That they did is seen at the end of the step:
velocity and pose are those that the substeps lead to.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.data import dataclass
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.impulses import EXPLAINED, Forces, Sum
from drop_physics.physics.kinematics import Kinematics, kinematics
from drop_physics.physics.laws.bullet.spin import MAX_TURN_RAD
from drop_physics.physics.laws.bullet.tree import known_terms, sum_of
from drop_physics.physics.moving import moved, moved_on, way_between
from drop_physics.physics.step_law import DampedTree, Reported
from drop_physics.physics.tree import States

Float64 = NDArray[np.float64]
Flags = NDArray[np.bool_]

HELD = 1e-6
"""Share of the largest term up to which impulses that are taken to be equal in all substeps may
differ: the solver stops before they are. Measured: 2e-8 where a body rests."""


@dataclass(frozen=True, eq=False)
class SubstepSum:
    """n steps, each as the sum of the impulses of its substeps; arrays have one row per step."""

    terms: Mapping[str, Float64]
    """Impulses by cause [N s, N m s], shape (n, size) each."""
    remainder: Float64
    """What the terms do not explain, shape (n, size)."""
    largest: Float64
    """The largest entry of any term, or impulse of a single force, in each step, shape (n,)."""
    unexplained: Float64
    """The remainder, or what the pose is off as an impulse, over `largest`; shape (n,)."""
    held: Flags
    """Where reported impulses were taken to be equal in all substeps, shape (n,)."""
    pd: Float64
    """PD_CONTROL's efforts in the last substep, shape (n, joint_rates)."""
    _energy_j: dict[str, Float64]
    _changed_j: Float64
    _momentum_kg_m_s: dict[str, Float64]
    _moved_kg_m_s: Float64

    @property
    def allowed(self) -> Float64:
        """Up to which share a remainder is what numbers leave, shape (n,)."""
        return np.where(self.held, HELD, EXPLAINED)

    def energy_j(self) -> dict[str, Float64]:
        """Return the change of kinetic and potential energy by cause [J], shape (n,) each."""
        return self._energy_j

    def energy_change_j(self) -> Float64:
        """Return the change of kinetic and potential energy [J], shape (n,)."""
        return self._changed_j

    def momentum_kg_m_s(self) -> dict[str, Float64]:
        """Return the change of the tree's linear momentum by cause, shape (n, 3) each."""
        return self._momentum_kg_m_s

    def momentum_change_kg_m_s(self) -> Float64:
        """Return the change of the tree's linear momentum, shape (n, 3)."""
        return self._moved_kg_m_s


def sum_of_substeps(
    body: DampedTree,
    states: States,
    reported: Reported,
    substeps: int,
    servos: Callable[[States], Float64],
) -> SubstepSum:
    """Return n steps of so many substeps from the n + 1 states before and after them.

    `reported` has the forces that motors and contacts had in the last substep; `servos` returns
    PD_CONTROL's efforts in some states, shape (n, joint_rates).

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
        return _summed(body, found, begins[-1], after, given[-1])


def _substeps(
    body: DampedTree,
    before: States,
    reported: Reported,
    substeps: int,
    servos: Callable[[States], Float64],
) -> tuple[list[States], list[Reported]]:
    """Return the states that the substeps of each step begin with, and what is known of them."""
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
    """Return the states after a substep."""
    matrices = mass_matrix(kin)
    impulse = sum(known_terms(body, kin, matrices, now.velocity, reported).values())
    velocity = now.velocity + np.linalg.solve(matrices, np.asarray(impulse)[:, :, None])[:, :, 0]
    held = np.clip(velocity, -body.velocity_limit, body.velocity_limit)
    return moved(body.tree, now, held, reported.timestep_s, MAX_TURN_RAD)


def _carried(forces: Forces, first: Kinematics, now: Kinematics) -> Forces:
    """Return forces at the centres of links that have moved since."""
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
    """Return the states of the substeps, those of one step after the other."""
    names = [column.name for column in fields(States)]
    return States(*(_woven([getattr(each, name) for each in begins]) for name in names))


def _reports_in_turn(given: Sequence[Reported]) -> Reported:
    """Return what is known of the substeps, those of one step after the other."""
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
) -> SubstepSum:
    """Return the sums of the substeps of each step, the last of which begins with `last`."""
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
    held: Flags = np.asarray(reported.motors.any(axis=1))
    if reported.geared is not None:
        held = held | reported.geared.any(axis=1)
    for forces in (reported.contacts, reported.constraints):
        acts = forces.force_n.any(axis=1) | forces.torque_n_m.any(axis=1)
        held[forces.step[acts]] = True
    none: dict[str, Float64] = {}
    return SubstepSum(
        terms=causes(found.terms),
        remainder=remainder,
        largest=largest,
        unexplained=np.divide(
            left, largest, out=np.where(left == 0, 0.0, np.inf), where=largest > 0
        ),
        held=held,
        pd=reported.pd,
        _energy_j=causes(found.energy_j()),
        _changed_j=whole(found.energy_change_j()),
        _momentum_kg_m_s=none if tree.fixed else causes(found.momentum_kg_m_s()),
        _moved_kg_m_s=np.zeros((count, 3)) if tree.fixed else whole(found.momentum_change_kg_m_s()),
    )

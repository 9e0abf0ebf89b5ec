"""Computes a body's changes of energy and momentum: by cause in steps, and by calls in between."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.physics.dynamics import lifted_j, mass_matrix
from drop_physics.physics.impulses import Summed
from drop_physics.physics.kinematics import Kinematics, kinematics
from drop_physics.physics.step_law import DampedTree
from drop_physics.physics.tree import BASE, States


@dataclass(frozen=True, eq=False)
class Transitions:
    """The m transitions between m + 1 states: n are steps, the others are changes by calls."""

    real: Flags
    """Whether a transition is a step, shape (m,)."""
    gravity_m_s2: Float64
    """Gravity in each step, shape (n, 3)."""

    @property
    def where(self) -> Int64:
        """The indices of the transitions that are steps, shape (n,)."""
        return np.flatnonzero(self.real)

    @property
    def gravity_then(self) -> Float64:
        """Gravity in each transition, shape (m, 3); for a call, that of the previous step."""
        return np.asarray(self.gravity_m_s2[np.maximum(np.cumsum(self.real) - 1, 0)])

    def spread(self, values: Float64) -> Float64:
        """Copy values of steps, shape (n, …), into an array of all transitions; 0 for calls."""
        out = np.zeros((len(self.real), *values.shape[1:]))
        out[self.real] = values
        return out


@dataclass(frozen=True, eq=False)
class Changes:
    """Changes of energy and momentum in n steps, and by calls before each of them."""

    energy_j: Mapping[str, Float64]
    """Changes of kinetic and potential energy by cause, shape (n,) each."""
    given_j: Mapping[str, float]
    """Changes of energy by cause, summed over the steps."""
    set_j: float
    """Change of energy between the steps, by calls that set states or gravity."""
    changed_j: float
    """Total change of energy."""
    momentum_kg_m_s: Mapping[str, Float64]
    """Changes of linear momentum by cause, shape (n, 3) each; empty if the base cannot move."""
    given_kg_m_s: Mapping[str, Float64]
    """Changes of linear momentum by cause, summed over the steps, shape (3,) each."""
    set_kg_m_s: Float64
    moved_kg_m_s: Float64
    """Total change of linear momentum, shape (3,)."""
    begin_j: float
    """Kinetic and potential energy before the first step; heights are measured from the origin."""
    after_j: Float64
    """Kinetic and potential energy after each step, shape (n,)."""


def changes_of(
    law: DampedTree,
    states: States,
    steps: Transitions,
    added: Summed | None,
    parts: Sequence[tuple[slice, slice]],
) -> list[Changes]:
    """Return the changes of energy and momentum in each step, by cause, and by calls.

    Without a sum, the whole change counts as remainder. `parts` contains slices of the transitions
    and of the steps of each body; transitions between bodies are left out.
    """
    if added is None:
        changed, moved = _changed(law, states, steps)
        energy, momentum = {"remainder": changed}, {} if law.tree.fixed else {"remainder": moved}
    else:
        energy, changed = {**added.energy_j}, added.changed_j
        momentum, moved = {**added.momentum_kg_m_s}, added.moved_kg_m_s
    first = np.array([transitions.start for transitions, _ in parts])
    begin_j, _ = energy_of(law, states.at(first), steps.gravity_then[first])
    energy, momentum = (
        {name: cause[steps.real] for name, cause in causes.items()} for causes in (energy, momentum)
    )
    starts = np.array([its.start for _, its in parts])
    given_j, given_kg_m_s = (
        {name: np.add.reduceat(cause, starts, axis=0) for name, cause in causes.items()}
        for causes in (energy, momentum)
    )
    found, all_weighed = [], _weighed(law, states, steps, starts)
    for row, (transitions, its) in enumerate(parts):
        real, start_j, weighed = steps.real[transitions], float(begin_j[row]), all_weighed[its]
        whole, way = changed[transitions], moved[transitions]
        # A change of gravity counts from the first step in which the new gravity acts.
        after_j = start_j + np.cumsum(whole)[real] + np.cumsum(weighed)
        change = Changes(
            energy_j={name: each[its] for name, each in energy.items()},
            given_j={name: float(each[row]) for name, each in given_j.items()},
            set_j=float(whole[~real].sum() + weighed.sum()),
            changed_j=float(whole.sum() + weighed.sum()),
            momentum_kg_m_s={name: each[its] for name, each in momentum.items()},
            given_kg_m_s={name: each[row] for name, each in given_kg_m_s.items()},
            set_kg_m_s=way[~real].sum(axis=0),
            moved_kg_m_s=way.sum(axis=0),
            begin_j=start_j,
            after_j=after_j,
        )
        found.append(change)
    return found


def energy_of(law: DampedTree, states: States, gravity_m_s2: Float64) -> tuple[Float64, Float64]:
    """Return kinetic and potential energy [J], shape (n,), and linear momentum, shape (n, 3).

    Heights are measured from the origin; the momentum of a tree with a fixed base counts as 0.
    `gravity_m_s2` has the shape (n, 3).
    """
    kin = kinematics(law.tree, states)
    kinetic, momenta = _moving(kin, states)
    return kinetic + _potential(kin, gravity_m_s2), momenta


def _changed(law: DampedTree, states: States, steps: Transitions) -> tuple[Float64, Float64]:
    kin = kinematics(law.tree, states)
    kinetic, momenta = _moving(kin, states)
    return np.diff(kinetic) + lifted_j(kin, steps.gravity_then), np.diff(momenta, axis=0)


def _moving(kin: Kinematics, states: States) -> tuple[Float64, Float64]:
    """Return kinetic energy, shape (n,), and linear momentum, shape (n, 3)."""
    momenta = np.einsum("nij,nj->ni", mass_matrix(kin), states.velocity)
    kinetic = 0.5 * np.einsum("ni,ni->n", states.velocity, momenta)
    return kinetic, np.zeros((len(states), 3)) if kin.tree.fixed else momenta[:, 3:6]


def _potential(kin: Kinematics, gravity_m_s2: Float64) -> Float64:
    """Return the potential energy -Σ m g·c [J], shape (n,)."""
    out = np.zeros(len(kin))
    for link in range(0 if kin.tree.fixed else BASE, kin.tree.links):
        pull = np.einsum("ni,ni->n", kin.position_m(link), gravity_m_s2)
        out -= kin.tree.masses_kg[link + 1] * pull
    return out


def _weighed(law: DampedTree, states: States, steps: Transitions, starts: Int64) -> Float64:
    """Return the change of potential energy by a change of gravity before each step [J], (n,).

    `starts` are the first steps of each body, before which gravity is unknown.
    """
    turned = np.diff(steps.gravity_m_s2, axis=0, prepend=0.0)
    turned[starts] = 0.0
    rows = np.flatnonzero(turned.any(axis=1))
    weighed = np.zeros(len(turned))
    if len(rows):
        kin = kinematics(law.tree, states.at(steps.where[rows]))
        weighed[rows] = _potential(kin, turned[rows])
    return weighed

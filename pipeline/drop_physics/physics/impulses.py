"""Writes a step of a kinematic tree as a sum of named impulses, for any engine.

    M (u' - u) = the sum of all terms + remainder

where M and everything else that depends on the pose is taken before the step. The terms that an
engine adds, and the forces that it reports, are defined by the engine's law (`step_law`, `laws`).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.physics.kinematics import Kinematics, generalised_at_points
from drop_physics.physics.rowed import Rowed
from drop_physics.physics.tree import RATES, Tree
from drop_physics.physics.vectors import largest, lengths, summed

MOVED = "bias"
"""Name of a term (Coriolis and gyroscopic forces) that counts as part of the integrator in changes
of energy and momentum."""
SOLVED = "integrator"
"""Term for the difference between an engine's integrator and the forces at the start of a step."""
PULLED = "gravity"
"""The term whose energy is potential energy (gravity)."""


def _no_rows() -> Int64:
    return np.empty(0, np.int64)


def _no_vectors() -> Float64:
    return np.empty((0, 3))


@dataclass(frozen=True, eq=False)
class Forces(Rowed):
    """Forces and torques on single links during one step each, one row per force, in world axes."""

    step: Int64 = field(default_factory=_no_rows)
    """Index of the step, shape (k,)."""
    link: Int64 = field(default_factory=_no_rows)
    """Link on which the force acts, shape (k,); `tree.BASE` for the base."""
    force_n: Float64 = field(default_factory=_no_vectors)
    point_m: Float64 = field(default_factory=_no_vectors)
    """Point of application of the force, shape (k, 3)."""
    torque_n_m: Float64 = field(default_factory=_no_vectors)
    """Torque in addition to the moment of the force, shape (k, 3)."""
    rolling: Flags = field(default_factory=lambda: np.empty(0, np.bool_))
    """Whether the contact has rolling or spinning friction, which the force does not include."""

    def between(self, first: int, last: int) -> Forces:
        """Return the rows of the steps from `first` up to `last`, with steps counted from 0."""
        if not len(self.step):
            return self
        if self._rises:
            kept = self.at(slice(*np.searchsorted(self.step, (first, last))))
        else:
            kept = self.at((self.step >= first) & (self.step < last))
        return replace(kept, step=kept.step - first)

    @cached_property
    def _rises(self) -> bool:
        return bool((self.step[1:] >= self.step[:-1]).all())


def impulses_of(kin: Kinematics, forces: Forces, timestep_s: Float64) -> Float64:
    """Return the generalised impulse of each row [N s, N m s], shape (k, size).

    `timestep_s` is the timestep of each step [s], shape (n,).
    """
    acting = generalised_at_points(
        kin, forces.step, forces.link, forces.force_n, forces.point_m, forces.torque_n_m
    )
    return acting * timestep_s[forces.step, None]


def per_step(forces: Forces, impulses: Float64, *, steps: int) -> Float64:
    """Sum the impulses of rows, (k, size), over each step, shape (steps, size)."""
    if not impulses.size:
        return np.zeros((steps, impulses.shape[1]))
    return summed(forces.step, impulses, count=steps)


def largest_per_step(
    tree: Tree, forces: Forces, gravity_m_s2: Float64, timestep_s: Float64
) -> Float64:
    """Return the largest impulse of a single force on a movable link [N s], shape (n,).

    Weights count, too; `gravity_m_s2` has the shape (n, 3).
    """
    free = [not tree.fixed]
    for link, parent in enumerate(tree.parents):
        free.append(free[parent + 1] or RATES[tree.joints[link]] > 0)
    moves = np.array(free)[forces.link + 1]
    impulses = lengths(forces.force_n) * timestep_s[forces.step]
    heaviest_kg = float(tree.masses_kg[free].max(initial=0.0))
    most: Float64 = heaviest_kg * lengths(gravity_m_s2) * timestep_s
    np.maximum.at(most, forces.step[moves], impulses[moves])
    return most


EXPLAINED = 1e-9
"""A remainder up to this share of the largest term counts as rounding."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Summed:
    """The n steps of a tree as sums of impulses; energy and momentum changes by cause."""

    terms: Mapping[str, Float64]
    """Impulses by cause [N s, N m s], shape (n, size) each."""
    remainder: Float64
    """The part of the change that no term explains, shape (n, size)."""
    largest: Float64
    """The largest entry of any term, or impulse of a single force, in each step, shape (n,)."""
    unexplained: Float64
    """Ratio of the largest entry of the remainder to `largest`, shape (n,)."""
    allowed: Float64
    """Maximum value of `unexplained` that counts as rounding, or as the possible error by substeps,
    shape (n,)."""
    energy_j: Mapping[str, Float64]
    """Changes of kinetic and potential energy by cause, shape (n,) each."""
    changed_j: Float64
    """Total change of energy, shape (n,)."""
    momentum_kg_m_s: Mapping[str, Float64]
    """Changes of linear momentum by cause, shape (n, 3) each; empty if the base cannot move."""
    moved_kg_m_s: Float64
    """Total change of linear momentum, shape (n, 3)."""


ROUNDED = 1e-6
"""Share of the momentum that counts as a term: the rounding error is 1e-15 of the momentum, and
thus 1e-9 of this share."""


@dataclass(frozen=True, eq=False)
class Sum:
    """The n steps of a tree, each as a sum of impulses; arrays have one row per step."""

    matrices: Float64
    """Mass matrix M before each step and after the last one, shape (n + 1, size, size)."""
    velocity: Float64
    """Velocity u before each step and after the last one, shape (n + 1, size)."""
    terms: Mapping[str, Float64]
    """Impulses by cause [N s, N m s], shape (n, size) each."""
    remainder: Float64
    """Change of momentum that the terms do not explain, shape (n, size)."""
    lifted_j: Float64
    """Changes of potential energy [J], shape (n,)."""
    forces_n_s: Float64
    """The largest impulse of a single force in each step [N s], shape (n,)."""

    @property
    def matrix(self) -> Float64:
        """Mass matrix M before each step, shape (n, size, size)."""
        return self.matrices[:-1]

    @cached_property
    def largest(self) -> Float64:
        """The largest impulse in each step, shape (n,), as the scale of rounding errors.

        The terms alone do not show the scale of the added numbers: a force may pass through all
        joint axes, or be balanced by another force. If hardly anything acts, a share of the
        momentum counts, since the momentum itself is rounded.
        """
        momentum = ROUNDED * largest(_applied(self.matrices[1:], self.velocity[1:]))
        entries = [largest(term) for term in self.terms.values()]
        return functools.reduce(np.maximum, [*entries, self.forces_n_s, momentum])

    @cached_property
    def unexplained(self) -> Float64:
        """Ratio of the remainder's largest entry to the largest impulse of the step, shape (n,).

        It is 0 if both are 0, and not finite if a state is not finite.
        """
        left, most = largest(self.remainder), self.largest
        return np.asarray(
            np.divide(left, most, out=np.where(left == 0, 0.0, np.inf), where=most > 0)
        )

    def summed(self, *, fixed: bool) -> Summed:
        """Return the sums, with energy and momentum; `fixed` tells whether the base never moves."""
        n = len(self.remainder)
        return Summed(
            terms=self.terms,
            remainder=self.remainder,
            largest=self.largest,
            unexplained=self.unexplained,
            allowed=np.full(n, EXPLAINED),
            energy_j=self.energy_j(),
            changed_j=self.energy_change_j(),
            momentum_kg_m_s={} if fixed else self.momentum_kg_m_s(),
            moved_kg_m_s=np.zeros((n, 3)) if fixed else self.momentum_change_kg_m_s(),
        )

    def energy_j(self) -> dict[str, Float64]:
        """Return the change of kinetic and potential energy by cause [J], shape (n,) each.

        An impulse P changes the kinetic energy by ½ (u' + u)·P at the same pose; the motion to the
        next pose changes it by ½ u'·(M' - M) u'. The sum of this change, the bias and gravity is
        the integrator's energy error, 0 for an exact integrator.
        """
        mean = 0.5 * (self.velocity[1:] + self.velocity[:-1])
        worked = {name: _rowwise(mean, term) for name, term in self.terms.items()}
        worked["remainder"] = _rowwise(mean, self.remainder)
        after, turned = self.velocity[1:], self._turned()
        integrator = 0.5 * _rowwise(after, turned) + self.lifted_j
        for name in (MOVED, PULLED, SOLVED):
            integrator = integrator + worked.pop(name, 0.0)
        return worked | {"integrator": integrator}

    def energy_change_j(self) -> Float64:
        """Return the total change of kinetic and potential energy [J], shape (n,)."""
        kinetic = 0.5 * _rowwise(self.velocity, _applied(self.matrices, self.velocity))
        return np.asarray(np.diff(kinetic) + self.lifted_j)

    def momentum_kg_m_s(self) -> dict[str, Float64]:
        """Return the change of the tree's linear momentum by cause, shape (n, 3) each.

        The momentum is in those rows of M u that belong to the base's velocity; the base must be
        able to move.
        """
        changes = {name: term[:, 3:6] for name, term in self.terms.items()}
        changes["remainder"] = self.remainder[:, 3:6]
        moved = changes.pop(MOVED, np.zeros((len(self.remainder), 3)))
        moved = moved + changes.pop(SOLVED, 0.0)
        return changes | {"integrator": moved + self._turned()[:, 3:6]}

    def momentum_change_kg_m_s(self) -> Float64:
        """Return the total change of the tree's linear momentum, shape (n, 3)."""
        return np.diff(_applied(self.matrices, self.velocity)[:, 3:6], axis=0)

    def _turned(self) -> Float64:
        """Return the effect of the changed mass matrix, (M' - M) u', shape (n, size)."""
        return _applied(self.matrices[1:] - self.matrices[:-1], self.velocity[1:])


def change_of(matrices: Float64, velocity: Float64) -> Float64:
    """Return the momentum change M (u' - u), shape (n, size), from n + 1 matrices and rates."""
    return _applied(matrices[:-1], np.diff(velocity, axis=0))


def _applied(matrices: Float64, vectors: Float64) -> Float64:
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])


def _rowwise(a: Float64, b: Float64) -> Float64:
    return np.asarray(np.einsum("ni,ni->n", a, b))

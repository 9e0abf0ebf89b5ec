"""The states of one body in a piece, as its steps began and ended: samples, and what calls set."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.bodies import Epoch, Epochs, Record
from drop_physics.physics.rowed import Rowed
from drop_physics.physics.tree import States, Tree
from drop_physics.trace.events import Put
from drop_physics.trace.states import Joints, Rows, motion_of

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Chain(Rowed):
    """States of one body, one after the other; what leads from one to the next is a step or a call.

    Arrays have one row per state.
    """

    base: Float64
    """Position, orientation (x, y, z, w), velocity, spin: shape (n, 13)."""
    position: Float64
    """Positions of the joints, shape (n, coordinates)."""
    velocity: Float64
    """Rates of the joints, shape (n, rates)."""
    effort: Float64
    """Efforts of the joints' motors in the step that led to it, shape (n, rates)."""
    steps: Int64
    """Steps of the simulation before each."""
    sampled: Flags
    """Whether it is a sample; else calls set it."""
    stepped: Flags
    """Whether a step led to it from the state before."""

    def states(self, tree: Tree) -> States:
        """Return the states as those of a tree."""
        base = [] if tree.fixed else [self.base[:, 10:13], self.base[:, 7:10]]
        u = np.hstack([*base, self.velocity])
        return States(self.base[:, :3], self.base[:, 3:7], self.position, u)

    def without_joints(self) -> Chain:
        """Return the states of the base alone."""
        nothing = np.empty((len(self), 0))
        return replace(self, position=nothing, velocity=nothing, effort=nothing)

    @staticmethod
    def of_base(base: Float64, steps: Int64) -> Chain:
        """Return samples of a base without joints, shape (n, 13)."""
        n, nothing = len(steps), np.empty((len(steps), 0))
        return Chain(
            base,
            nothing,
            nothing,
            nothing,
            steps.copy(),
            np.ones(n, np.bool_),
            np.zeros(n, np.bool_),
        )


def chain_of(
    record: Record, bases: Rows | None, joints: Joints | None, last: Chain | None
) -> Chain | None:
    """Return the states of a body in a piece; None if it has no sample there.

    Parameters
    ----------
    record
        What was told of it.
    bases, joints
        Its samples in the piece.
    last
        Samples before; they are the first states of the chain.
    """
    samples = _samples(record, bases, joints)
    if samples is None:
        return None
    chain = samples if last is None else last.then(samples)
    first = len(chain) - len(samples)
    lives = record.lives(chain.steps)
    chain.stepped[1:] = (np.diff(chain.steps) == 1) & (np.diff(lives) == 0)
    chain.stepped[0] = False
    before = record.puts_between(int(samples.steps[0]) - 1, int(samples.steps[-1]))
    puts = {each.at.step: each for each in before if each.counts}
    rows = first + np.flatnonzero(np.isin(chain.steps[first:] - 1, [*puts]))
    if not len(rows):
        return chain
    chain.stepped[rows] = True
    put = put_states([puts[int(chain.steps[row]) - 1] for row in rows], chain)
    where = np.argsort(np.concatenate((np.arange(len(chain)), rows - 0.5)), kind="stable")
    return chain.then(put).at(where)


def _samples(record: Record, bases: Rows | None, joints: Joints | None) -> Chain | None:
    if joints is None and bases is None:
        return None
    steps = joints.steps if joints is not None else bases["step"]  # type: ignore[index]
    n = len(steps)
    base = record.told(steps)
    if bases is not None:
        sampled = bases["step"]
        within = np.isin(sampled, steps)
        base[np.searchsorted(steps, sampled[within])] = motion_of(bases)[within]
    nothing = np.empty((n, 0))
    q, u, effort = (
        (nothing,) * 3 if joints is None else (joints.position, joints.velocity, joints.effort)
    )
    return Chain(base, q, u, effort, steps.copy(), np.ones(n, np.bool_), np.zeros(n, np.bool_))


def put_states(puts: Sequence[Put], like: Chain) -> Chain:
    """Return states that calls set, with as many joints as others."""
    n = len(puts)
    return Chain(
        base=np.array([put.base for put in puts]),
        position=np.array([put.position for put in puts]),
        velocity=np.array([put.velocity for put in puts]),
        effort=np.zeros((n, like.effort.shape[1])),
        steps=np.array([put.at.step for put in puts], np.int64),
        sampled=np.zeros(n, np.bool_),
        stepped=np.zeros(n, np.bool_),
    )


@dataclass(frozen=True, eq=False)
class Stretch:
    """States of a body under constant settings, the first of which a step begins with."""

    chain: Chain
    epoch: Epoch
    first: int
    """Rows of these states in the whole chain."""


def stretches_of(chain: Chain, first: int, epochs: Epochs) -> Iterator[Stretch]:
    """Yield the stretches of a chain whose steps end at state `first` or later."""
    ends = np.flatnonzero(chain.stepped)
    ends = ends[ends >= first]
    for rows, epoch in epochs.of(chain.steps[ends] - 1):
        begin, end = int(ends[rows][0]) - 1, int(ends[rows][-1]) + 1
        yield Stretch(chain.at(slice(begin, end)), epoch, begin)

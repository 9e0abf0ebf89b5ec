"""Lists the states of one body in a chunk: samples, and states that calls set in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.bodies import Record
from drop_physics.physics.rowed import Rowed
from drop_physics.physics.tree import States, Tree
from drop_physics.trace.events import Put
from drop_physics.trace.states import Joints, Rows, motion_of


@dataclass(frozen=True, eq=False)
class BodyHistory(Rowed):
    """Consecutive states of a body; each follows from the previous one by a step or by calls.

    Arrays have one row per state.
    """

    base: Float64
    """Position, orientation (x, y, z, w), velocity, spin: shape (n, 13)."""
    position: Float64
    """Positions of the joints, shape (n, coordinates)."""
    velocity: Float64
    """Rates of the joints, shape (n, rates)."""
    effort: Float64
    """Motor efforts of the joints in the step that led to the state, shape (n, rates)."""
    steps: Int64
    """Number of steps of the simulation before each state."""
    sampled: Flags
    """Whether the state is a sample; otherwise calls set it."""
    stepped: Flags
    """Whether a step led from the previous state to this one."""

    def states(self, tree: Tree) -> States:
        """Return the states as `States` of a tree."""
        base = [] if tree.fixed else [self.base[:, 10:13], self.base[:, 7:10]]
        u = np.hstack([*base, self.velocity])
        return States(self.base[:, :3], self.base[:, 3:7], self.position, u)

    def without_joints(self) -> BodyHistory:
        """Return the states of the base alone."""
        nothing = np.empty((len(self), 0))
        return replace(self, position=nothing, velocity=nothing, effort=nothing)

    @staticmethod
    def of_base(base: Float64, steps: Int64) -> BodyHistory:
        """Convert samples of a base to a history of a body without joints, shape (n, 13)."""
        n, nothing = len(steps), np.empty((len(steps), 0))
        return BodyHistory(
            base,
            nothing,
            nothing,
            nothing,
            steps.copy(),
            np.ones(n, np.bool_),
            np.zeros(n, np.bool_),
        )


def history_of(
    record: Record, bases: Rows | None, joints: Joints | None, last: BodyHistory | None
) -> BodyHistory | None:
    """Return the states of a body in a chunk; None if the chunk has no sample of the body.

    Parameters
    ----------
    record
        The events of the body.
    bases, joints
        The samples of base and joints in the chunk.
    last
        The last states of the previous chunk, with which the history begins.
    """
    samples = _samples(record, bases, joints)
    if samples is None:
        return None
    history = samples if last is None else last.then(samples)
    first = len(history) - len(samples)
    lives = record.lives(history.steps)
    history.stepped[1:] = (np.diff(history.steps) == 1) & (np.diff(lives) == 0)
    history.stepped[0] = False
    before = record.puts_between(int(samples.steps[0]) - 1, int(samples.steps[-1]))
    puts = {each.at.step: each for each in before if each.counts}
    if not puts:
        return history
    rows = first + np.flatnonzero(np.isin(history.steps[first:] - 1, [*puts]))
    history.stepped[rows] = True
    put = put_states([puts[int(history.steps[row]) - 1] for row in rows], history)
    where = np.argsort(np.concatenate((np.arange(len(history)), rows - 0.5)), kind="stable")
    return history.then(put).at(where)


def _samples(record: Record, bases: Rows | None, joints: Joints | None) -> BodyHistory | None:
    if joints is None and bases is None:
        return None
    steps = joints.steps if joints is not None else bases["step"]  # type: ignore[index]
    if bases is not None and np.array_equal(steps, bases["step"]):
        base = np.ascontiguousarray(motion_of(bases))
    else:
        base = record.base_at(steps)
        if bases is not None:
            sampled = bases["step"]
            within = np.isin(sampled, steps)
            base[np.searchsorted(steps, sampled[within])] = motion_of(bases)[within]
    history = BodyHistory.of_base(base, steps)
    if joints is None:
        return history
    return replace(
        history, position=joints.position, velocity=joints.velocity, effort=joints.effort
    )


def put_states(puts: Sequence[Put], like: BodyHistory) -> BodyHistory:
    """Return the states that calls set, with as many joint efforts as the states in `like`."""
    n = len(puts)
    return BodyHistory(
        base=np.array([put.base for put in puts]),
        position=np.array([put.position for put in puts]),
        velocity=np.array([put.velocity for put in puts]),
        effort=np.zeros((n, like.effort.shape[1])),
        steps=np.array([put.at.step for put in puts], np.int64),
        sampled=np.zeros(n, np.bool_),
        stepped=np.zeros(n, np.bool_),
    )

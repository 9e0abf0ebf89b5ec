"""Divides the remainder of a step among causes whose impulses the engine does not report.

Such a cause can act only in certain directions: a stop pushes its joint inwards; a clamp acts on
one entry of u; rolling and spinning friction are torques on touching links. The part of the
remainder in these directions is attributed to these causes; the rest stays the remainder. In a tree
with few degrees of freedom, the directions may span the whole space: the causes then explain any
remainder, which proves nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.physics.kinematics import Kinematics, spin_jacobian
from drop_physics.physics.vectors import distinct_bytes

DEPENDENT = 1e-13
"""Singular values below this share of the largest are treated as zero."""


@dataclass(frozen=True, eq=False)
class Unreported:
    """The directions in which unreported impulses may act, in n steps."""

    UP: ClassVar[int] = 1
    DOWN: ClassVar[int] = 2

    stops: Int64
    """Directions in which a joint stop may push each entry of u: UP, DOWN, both or 0; shape (n,
    size)."""
    clamped: Flags
    """Whether each entry of u is at the engine's limit after the step, shape (n, size)."""
    step: Int64
    """Step index of each contact with rolling friction, shape (k,)."""
    link: Int64
    """Link of each contact with rolling friction, shape (k,)."""


class Shared(NamedTuple):
    """A remainder, divided among unreported causes; arrays have shape (n, size)."""

    rolling: Float64
    stops: Float64
    clamp: Float64
    remainder: Float64


def shared_out(left: Float64, matrices: Float64, kin: Kinematics, may: Unreported) -> Shared:
    """Divide the remainder `left`, shape (n, size), among the unreported causes that may act.

    `matrices` are the mass matrices, shape (n, size, size); `may` states which causes may act in
    each step.
    """
    shared = Shared(*(np.zeros_like(left) for _ in range(4)))
    stops, touching = may.stops.copy(), _touching(may, len(left), kin.tree.links)
    # With stops alone each entry is its own.
    shared.stops[stops != 0] = left[stops != 0]
    finite = np.isfinite(left).all(axis=1) & np.isfinite(matrices).all(axis=(1, 2))
    open_to_several = (may.clamped.any(axis=1) | touching.any(axis=1)) & finite
    while open_to_several.any():
        keys = np.hstack((touching, stops != 0, may.clamped))
        _fit(left, matrices, kin, keys, np.flatnonzero(open_to_several), shared)
        # A stop that would have to pull does nothing: fit again without it.
        outwards = _outwards(shared.stops, stops)
        stops[outwards] = 0
        open_to_several &= outwards.any(axis=1)
    shared.stops[_outwards(shared.stops, stops)] = 0.0
    shared.remainder[:] = left - shared.rolling - shared.stops - shared.clamp
    return shared


def _outwards(pushed: Float64, stops: Int64) -> Flags:
    """Flag impulses that push a joint towards its stop, which no stop can do, shape (n, size)."""
    up, down = stops & Unreported.UP != 0, stops & Unreported.DOWN != 0
    return np.asarray(((pushed > 0) & ~up) | ((pushed < 0) & ~down))


def _touching(may: Unreported, steps: int, links: int) -> Flags:
    """Flag the links with rolling friction in each step, shape (steps, links + 1)."""
    touching = np.zeros((steps, links + 1), np.bool_)
    touching[may.step, may.link + 1] = True
    return touching


def _fit(
    left: Float64, matrices: Float64, kin: Kinematics, keys: Flags, steps: Int64, shared: Shared
) -> None:
    """Fit the remainders of steps in the possible directions, for equal sets of directions at once.

    `keys` flags the directions of each step: touching links, stops and clamped entries.
    """
    size, links = left.shape[1], kin.tree.links
    firsts, which = distinct_bytes(keys[steps])
    for number, kind in enumerate(keys[steps[firsts]]):
        rows = steps[which == number]
        touching, stops, clamped = np.split(kind, (links + 1, links + 1 + size))
        turning = [
            np.swapaxes(spin_jacobian(kin, int(link) - 1, rows), 1, 2)
            for link in np.flatnonzero(touching)
        ]
        pushed = np.broadcast_to(np.eye(size)[:, stops], (len(rows), size, stops.sum()))
        rolling = np.concatenate(turning, axis=2) if turning else pushed[:, :, :0]
        parts = rolling, pushed, matrices[rows][:, :, clamped]
        found = _parts(left[rows], parts)
        shared.rolling[rows], shared.stops[rows], shared.clamp[rows] = found


def _parts(left: Float64, parts: tuple[Float64, ...]) -> list[Float64]:
    """Return the least-squares contribution of each group of directions, shape (k, size) each.

    Directions that are nearly dependent have large coefficients, whose rounding would add to the
    remainder. The projection on all directions together has no such error: the first group gets the
    difference.
    """
    directions = np.concatenate(parts, axis=2)
    sizes = np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions / np.where(sizes > 0, sizes, 1.0)
    left_ones, values, right_ones = np.linalg.svd(directions, full_matrices=False)
    kept = values > DEPENDENT * values[:, :1]
    along = np.where(kept, np.einsum("nij,ni->nj", left_ones, left), 0.0)
    share = np.einsum("nji,nj->ni", right_ones, np.divide(along, values, out=along * 0, where=kept))
    found, first = [], 0
    for part in parts:
        last = first + part.shape[2]
        found.append(np.einsum("nij,nj->ni", directions[:, :, first:last], share[:, first:last]))
        first = last
    if parts[0].shape[2]:
        found[0] += np.einsum("nij,nj->ni", left_ones, along) - sum(found)
    return found

"""Contact points of a chunk, seen from both bodies, and sums over each pair of bodies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.steps import Steps
from drop_physics.explain.touching import among
from drop_physics.physics.columns import cross, product, times
from drop_physics.physics.kinematics import kinematics, link_numbers, motion
from drop_physics.physics.vectors import cross as cross_of_rows
from drop_physics.physics.vectors import distinct, distinct_rows, groups, lengths
from drop_physics.trace.states import Rows

N = TypeVar("N", np.float64, np.int64)

PRESSED = 1e-9
"""A force below this value counts as zero [N]."""
COMMON = 0.99
"""Minimum cosine of the angle between two normals that count as one line."""


@dataclass(frozen=True, eq=False)
class Points:
    """The k contact points, ordered by step and pair; side 0 is the body with the lower id."""

    step: Int64
    """The sample after the step in which the contact existed, shape (k,)."""
    body: Int64
    """Ids of the bodies on both sides, shape (k, 2)."""
    link: Int64
    at_m: Float64
    """The contact point on each side, shape (k, 2, 3)."""
    normal: Float64
    """Unit vector towards side 0, shape (k, 3)."""
    distance_m: Float64
    """Distance of the two sides at the start of the step [m], negative if they overlap."""
    normal_n: Float64
    tangential_n: Float64
    """Friction force on side 0, shape (k, 3)."""
    friction: Float64
    """Coefficient of friction, the product of both sides' coefficients."""
    restitution: Float64
    """Coefficient of restitution, the product of both sides' coefficients."""
    began_m_s: Float64
    """Velocities of the points on both sides at the start of the step, shape (k, 2, 3)."""
    ended_m_s: Float64
    """Velocities at the end of the step, shape (k, 2, 3)."""
    carried_m_s: Float64
    """Velocities on both sides at the end of the step, of the material points that were in contact
    at its start, shape (k, 2, 3)."""
    timestep_s: Float64
    explained: Flags
    """Whether the step of each side is explained, shape (k, 2); True for immovable sides."""
    moves: Flags
    """Whether each side can move, shape (k, 2)."""

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.step)

    def at(self, rows: Int64) -> Points:
        """Return the contact points in the given rows."""
        return Points(**{each.name: getattr(self, each.name)[rows] for each in fields(Points)})

    @property
    def force_n(self) -> Float64:
        """Return the force on side 0, shape (k, 3)."""
        return np.asarray(self.normal * self.normal_n[:, None] + self.tangential_n)

    @property
    def energy_j(self) -> Float64:
        """Energy given to each side: force · mean velocity · timestep, per point, shape (k, 2)."""
        mean = 0.5 * (self.began_m_s + self.ended_m_s)
        worked = np.einsum("ki,ksi->ks", self.force_n, mean) * self.timestep_s[:, None]
        return np.where(self.moves, worked * [1.0, -1.0], 0.0)

    @cached_property
    def approach_m_s(self) -> Float64:
        """Speed of approach along the normal at the start of the step, shape (k,)."""
        return -_along(self.began_m_s[:, 0] - self.began_m_s[:, 1], self.normal)

    @cached_property
    def parting_m_s(self) -> Float64:
        """Separation speed along the normal at the end of the step, shape (k,)."""
        return _along(self.ended_m_s[:, 0] - self.ended_m_s[:, 1], self.normal)

    @cached_property
    def slip_m_s(self) -> Float64:
        """Tangential velocity of side 0 relative to side 1 at the end of the step, shape (k, 3)."""
        return _across(self.ended_m_s[:, 0] - self.ended_m_s[:, 1], self.normal)

    @cached_property
    def slipped_m_s(self) -> Float64:
        """Tangential velocity of side 0 relative to side 1 at the start of the step, (k, 3)."""
        return _across(self.began_m_s[:, 0] - self.began_m_s[:, 1], self.normal)


@dataclass(frozen=True, eq=False)
class PairGroups:
    """Array rows grouped by a key, such as a pair of bodies; g groups, sorted by key."""

    order: Int64
    """The row indices, one group after the other."""
    starts: Int64
    """Index in `order` of the first element of each group, shape (g,)."""

    @staticmethod
    def of(keys: Int64) -> PairGroups:
        """Group the rows by key."""
        order = np.argsort(keys, kind="stable")
        return PairGroups(order, np.flatnonzero(np.diff(keys[order], prepend=-1)))

    @property
    def firsts(self) -> Int64:
        """The first row of each group."""
        return self.order[self.starts]

    @property
    def lasts(self) -> Int64:
        """The last row of each group."""
        return np.asarray(self.order[np.append(self.starts[1:], len(self.order)) - 1])

    def rows(self) -> Iterator[Int64]:
        """Yield the rows of each group."""
        yield from np.split(self.order, self.starts[1:]) if len(self.order) else ()

    def summed(self, values: NDArray[N]) -> NDArray[N]:
        """Return the sum of each group's values, shape (g, …)."""
        return np.asarray(np.add.reduceat(values[self.order], self.starts, axis=0))

    def most(self, values: Float64) -> Float64:
        """Return the maximum of each group's values, shape (g,)."""
        return np.asarray(np.maximum.reduceat(values[self.order], self.starts))

    def first_of_most(self, values: Float64) -> Int64:
        """Return the first row of each group at which its maximum occurs, shape (g,)."""
        return self._of_most(values, np.minimum, len(self.order))

    def last_of_most(self, values: Float64) -> Int64:
        """Return the last row of each group at which its maximum occurs, shape (g,)."""
        return self._of_most(values, np.maximum, -1)

    def _of_most(self, values: Float64, which: np.ufunc, never: int) -> Int64:
        greatest = np.repeat(self.most(values), np.diff([*self.starts, len(self.order)]))
        places = np.where(values[self.order] == greatest, np.arange(len(self.order)), never)
        return np.asarray(self.order[which.reduceat(places, self.starts)])


@dataclass(frozen=True, eq=False)
class Pairs:
    """The contacts of body pairs, summed over contact points; m rows, one per step and pair."""

    points: Points
    starts: Int64
    """The first point of each row, shape (m,)."""

    @cached_property
    def step(self) -> Int64:
        """The sample that each row's step leads to, shape (m,)."""
        return self.points.step[self.starts]

    @cached_property
    def body(self) -> Int64:
        """Ids of both bodies, shape (m, 2)."""
        return self.points.body[self.starts]

    @cached_property
    def timestep_s(self) -> Float64:
        """The timestep of each row, shape (m,)."""
        return self.points.timestep_s[self.starts]

    @cached_property
    def row(self) -> Int64:
        """Index of the row to which each point belongs, shape (k,)."""
        counts = np.diff([*self.starts, len(self.points)])
        return np.repeat(np.arange(len(self.starts)), counts)

    @cached_property
    def normal_n(self) -> Float64:
        """Sum of the normal forces, shape (m,)."""
        return self.summed(self.points.normal_n)

    @cached_property
    def available_n(self) -> Float64:
        """The maximum possible friction, Σ μN, shape (m,)."""
        return self.summed(self.points.friction * self.points.normal_n)

    @cached_property
    def tangential_n(self) -> Float64:
        """Friction force on side 0, shape (m, 3)."""
        return self.summed(self.points.tangential_n)

    @cached_property
    def rubbed_n(self) -> Float64:
        """Sum of the magnitudes of the points' friction forces, shape (m,)."""
        return self.summed(lengths(self.points.tangential_n))

    @cached_property
    def acts(self) -> Flags:
        """Flag the rows in which a contact force acts, shape (m,)."""
        return self.normal_n > PRESSED

    @cached_property
    def force_n(self) -> Float64:
        """Force on side 0, shape (m, 3)."""
        return self.summed(self.points.force_n)

    @cached_property
    def pressed_n(self) -> Float64:
        """Vector sum of the normal forces, shape (m, 3); 0 if they cancel, as in a grip."""
        return self.summed(self.points.normal * self.points.normal_n[:, None])

    @cached_property
    def energy_j(self) -> Float64:
        """Energy that the contacts gave to each body, shape (m, 2)."""
        return self.summed(self.points.energy_j)

    @cached_property
    def depth_m(self) -> Float64:
        """The deepest overlap, shape (m,); 0 without overlap."""
        return np.maximum(self.most(-self.points.distance_m), 0.0)

    @cached_property
    def line(self) -> Float64:
        """The normal of the point with the largest normal force, shape (m, 3)."""
        if not len(self.starts):
            return np.zeros((0, 3))
        greatest = self.most(self.points.normal_n)[self.row]
        # The last of several that are pressed as much.
        places = np.where(self.points.normal_n < greatest, -1, np.arange(len(self.points)))
        return np.asarray(self.points.normal[np.maximum.reduceat(places, self.starts)])

    @cached_property
    def one_line(self) -> Flags:
        """Flag the rows in which all loaded points have parallel normals, shape (m,)."""
        cosine = np.abs(_along(self.points.normal, self.line[self.row]))
        alike = np.where(self.points.normal_n > 0, cosine, 1.0) >= COMMON
        return np.asarray(-self.most(-alike.astype(float)) > 0)

    @cached_property
    def slip_m_s(self) -> Float64:
        """Slip speed at the end of the step, averaged over points by normal force, (m,)."""
        return self._weighted(lengths(self.points.slip_m_s))

    @cached_property
    def began_slip_m_s(self) -> Float64:
        """Slip speed at the start of the step, averaged by normal force, shape (m,)."""
        return self._weighted(lengths(self.points.slipped_m_s))

    @cached_property
    def approach_m_s(self) -> Float64:
        """Approach speed at the start of the step, averaged by normal force, shape (m,)."""
        return self._weighted(self.points.approach_m_s)

    @cached_property
    def parting_m_s(self) -> Float64:
        """Separation speed at the end of the step, averaged by normal force, shape (m,)."""
        return self._weighted(self.points.parting_m_s)

    @cached_property
    def gap_m(self) -> Float64:
        """Gap between the bodies at the start of the step, averaged by normal force, shape (m,)."""
        return self._weighted(np.maximum(self.points.distance_m, 0.0))

    @cached_property
    def centre_m(self) -> Float64:
        """The centre of contact on each side, weighted by normal force, shape (m, 2, 3)."""
        return self._weighted(self.points.at_m)

    @cached_property
    def began_m_s(self) -> Float64:
        """Velocity of each side at the start of the step, weighted by force, shape (m, 2, 3)."""
        return self._weighted(self.points.began_m_s)

    @cached_property
    def ended_m_s(self) -> Float64:
        """Velocity of each side at the end of the step, weighted by normal force."""
        return self._weighted(self.points.ended_m_s)

    @cached_property
    def carried_m_s(self) -> Float64:
        """Mean of `Points.carried_m_s`, weighted by normal force."""
        return self._weighted(self.points.carried_m_s)

    @cached_property
    def held_n_m(self) -> Float64:
        """Largest moment that friction can exert about the contact's centre, shape (m, 2)."""
        points = self.points
        arms_m = np.cross(points.at_m - self.centre_m[self.row], points.normal[:, None])
        return self.summed(
            (points.friction * points.normal_n)[:, None] * np.linalg.norm(arms_m, axis=2)
        )

    @cached_property
    def restitution(self) -> Float64:
        """The largest coefficient of restitution, shape (m,)."""
        return self.most(self.points.restitution)

    @cached_property
    def explained(self) -> Flags:
        """Flag the rows in which the steps of both bodies are explained, shape (m, 2)."""
        return self.points.explained[self.starts]

    @cached_property
    def of_body(self) -> dict[int, Int64]:
        """The contact points of each body, by body id."""
        sides = np.flatnonzero(self.points.body[:, 0] != self.points.body[:, 1])
        bodies = self.points.body[sides]
        return {number: np.sort(sides[its // 2]) for number, its in groups(bodies.reshape(-1))}

    @cached_property
    def grouped(self) -> PairGroups:
        """The rows of each pair of bodies, sorted by their ids."""
        return PairGroups.of(self.body @ [self.body.max(initial=0) + 1, 1])

    @cached_property
    def by_link(self) -> LinkPairs:
        """The same contact points, summed per step over pairs of links."""
        keys = np.column_stack((self.points.step, self.points.body, self.points.link))
        order = np.lexsort(keys.T[::-1])
        points = self.points if (np.diff(order) > 0).all() else self.points.at(order)
        return LinkPairs(points, _firsts(keys[order]))

    def by_pair(self, which: Flags | None = None) -> Iterator[tuple[int, int, Int64]]:
        """Yield the ids of each pair, the lower first, and its rows, restricted to `which`."""
        for rows in self.grouped.rows():
            its = rows if which is None else rows[which[rows]]
            if len(its):
                first, second = self.body[its[0]].tolist()
                yield first, second, its

    def summed(self, values: Float64) -> Float64:
        """Return the sum of the points' values in each row, shape (m, …)."""
        if not len(self.starts):
            return np.zeros((0, *values.shape[1:]))
        return np.asarray(np.add.reduceat(values, self.starts, axis=0))

    def most(self, values: Float64) -> Float64:
        """Return the maximum of the points' values in each row, shape (m, …)."""
        if not len(self.starts):
            return np.zeros(0)
        return np.asarray(np.maximum.reduceat(values, self.starts))

    def _weighted(self, values: Float64) -> Float64:
        total = self.normal_n.reshape(-1, *[1] * (values.ndim - 1))
        weighted = self.summed((values.T * self.points.normal_n).T)
        return np.divide(weighted, total, out=np.zeros_like(weighted), where=total > 0)


class LinkPairs(Pairs):
    """The contacts of link pairs, summed over contact points; m rows, one per step and pair."""

    @cached_property
    def link(self) -> Int64:
        """Both links, shape (m, 2)."""
        return self.points.link[self.starts]

    @cached_property
    def grouped(self) -> PairGroups:
        """The rows of each pair of links, sorted by the ids of their bodies, then by the links."""
        _, _, which = distinct_rows(np.concatenate((self.body, self.link), axis=1))
        return PairGroups.of(which)


def pairs_of(explained: ExplainedPiece) -> Pairs:
    """Return the contact points of a chunk, grouped by pair of bodies."""
    points = _points(explained)
    return Pairs(points, _firsts(np.column_stack((points.step, points.body))))


def _firsts(keys: Int64) -> Int64:
    """Return the index of the first row of each run of equal rows; `keys` has the shape (n, k)."""
    new = np.ones(len(keys), np.bool_)
    new[1:] = (keys[1:] != keys[:-1]).any(axis=1)
    return np.flatnonzero(new)


def _points(explained: ExplainedPiece) -> Points:
    contacts, records = explained.piece.contacts, explained.records
    # The points that the engine could name by their bodies, in the order of steps and pairs.
    a, b = contacts["body_a"], contacts["body_b"]
    known = among(records, a) & among(records, b)
    low, high = np.minimum(a, b), np.maximum(a, b)
    many = int(high.max(initial=0)) + 1
    keys = (contacts["step"] * many + low) * many + high
    table, places = contacts, np.arange(len(contacts))
    if not known.all() or (np.diff(keys) < 0).any():
        order = np.argsort(keys, kind="stable")
        order = order[known[order]]
        table, places = contacts[order], np.full(len(contacts), -1)
        places[order] = np.arange(len(order))
    swapped = table["body_a"] > table["body_b"]
    flip = np.where(swapped, -1.0, 1.0)
    bodies, links = (_by_side(table, what, "", swapped) for what in ("body", "link"))
    sides = _Sides(table["step"], bodies, _by_side(table, "position", "_m", swapped))
    sides.move(explained, places, swapped)
    friction = (
        sum(table[f"friction_{k}_direction"] * table[f"friction_{k}_n"][:, None] for k in (1, 2))
        * (table["normal_force_n"] != 0)[:, None]
    )  # as in `Touching`
    lateral, bouncing = (
        np.multiply(
            *(
                records.coefficients(name, table["step"], bodies[:, side], links[:, side])
                for side in (0, 1)
            )
        )
        for name in ("lateral_friction", "restitution")
    )
    return Points(
        step=np.ascontiguousarray(table["step"]),
        body=bodies,
        link=links,
        at_m=sides.at_m,
        normal=table["normal"] * flip[:, None],
        distance_m=np.ascontiguousarray(table["distance_m"]),
        normal_n=np.ascontiguousarray(table["normal_force_n"]),
        tangential_n=np.asarray(friction) * flip[:, None],
        friction=lateral
        if explained.frictions is None
        else _known(explained.frictions, bodies, links),
        restitution=bouncing,
        began_m_s=sides.began_m_s,
        ended_m_s=sides.ended_m_s,
        carried_m_s=sides.carried_m_s,
        timestep_s=sides.timestep_s,
        explained=sides.explained,
        moves=sides.moves,
    )


def _by_side(table: Rows, what: str, unit: str, swapped: Flags) -> NDArray[Any]:
    """Return a column for both sides of each point; side 0 is the body with the lower id."""
    both = np.stack([table[f"{what}_{side}{unit}"] for side in "ab"], axis=1)
    both[swapped] = both[swapped, ::-1]
    return both


class _Sides:
    """Velocities at k contact points, for the material of either body; shapes (k, 2, …)."""

    def __init__(self, ends: Int64, bodies: Int64, at_m: Float64) -> None:
        self._ends, self._bodies = ends, bodies
        count = len(ends)
        self.at_m = at_m
        self.began_m_s, self.ended_m_s, self.carried_m_s = np.zeros((3, count, 2, 3))
        self.timestep_s = np.zeros(count)
        self.explained = np.ones((count, 2), np.bool_)
        self.moves = np.zeros((count, 2), np.bool_)

    def move(self, explained: ExplainedPiece, places: Int64, swapped: Flags) -> None:
        """Compute the velocities from explained steps; `places` gives the rows of engine points."""
        for batch, verdict in explained.batches:
            if len(batch.whole.sides.step) and batch.whole.law.tree.size:
                self._take(batch.whole, verdict.why < 0, places, swapped)
        # What only calls move, while it has no mass; most never do.
        for side in (0, 1):
            still = np.flatnonzero(~self.moves[:, side])
            for number, its in groups(self._bodies[still, side]):
                rows = still[its]
                base = _base_at(explained, number, self._ends[rows])
                if not base[:, 7:].any():
                    continue
                arm = self.at_m[rows, side] - base[:, :3]
                moved = base[:, 7:10] + cross_of_rows(base[:, 10:13], arm)
                for each in (self.began_m_s, self.ended_m_s, self.carried_m_s):
                    each[rows, side] = moved

    def _take(self, steps: Steps, explained: Flags, places: Int64, swapped: Flags) -> None:
        point = places[steps.sides.point]
        if (point < 0).any():
            kept = np.flatnonzero(point >= 0)
            sides, row, point = (
                steps.sides.at(kept),
                steps.reported.contacts.step[kept],
                point[kept],
            )
        else:
            sides, row = steps.sides, steps.reported.contacts.step
        side = np.where(sides.is_a ^ swapped[point], 0, 1)
        used, rows = distinct(row)
        kin, then = (
            kinematics(steps.law.tree, each.at(used)) for each in (steps.before, steps.after)
        )
        at_m, place = np.ascontiguousarray(self.at_m[point, side].T), 2 * point + side
        links = link_numbers(sides.link)
        for here, states, out in (
            (kin, steps.before, self.began_m_s),
            (kin, steps.after, self.ended_m_s),
            (then, steps.after, self.carried_m_s),
        ):
            moved = motion(here, states.velocity[used])
            for link in links:
                its = np.flatnonzero(sides.link == link) if len(links) > 1 else slice(None)
                k = min(link, steps.law.tree.links - 1) + 1
                at = rows[its]
                arm = at_m[:, its] - kin.centres[k].take(at, axis=1)
                if here is then:
                    turn = product(then.rotations[k], np.swapaxes(kin.rotations[k], 0, 1))
                    arm = times(turn.take(at, axis=2), arm)
                turned = cross(moved.spins[k].take(at, axis=1), arm)
                moving = moved.velocities[k].take(at, axis=1) + turned
                out.reshape(-1, 3)[place[its]] = np.ascontiguousarray(moving.T)
        self.timestep_s[point] = steps.reported.timestep_s[row]
        self.explained[point, side] = explained[row]
        self.moves[point, side] = True


def _base_at(explained: ExplainedPiece, number: int, ends: Int64) -> Float64:
    """Return the states of a massless base, shape (n, 13), as recorded, for conveyor belts."""
    base = explained.records[number].base_at(ends)
    history = explained.histories.get(number)
    if history is not None:
        rows = np.flatnonzero(history.sampled)
        at = np.minimum(np.searchsorted(history.steps[rows], ends), len(rows) - 1)
        known = history.steps[rows[at]] == ends
        base[known] = history.base[rows[at[known]]]
    return base


def _known(
    frictions: Mapping[tuple[int, int, int, int], float], bodies: Int64, links: Int64
) -> Float64:
    """Return the friction coefficient of each contact point, shape (k,); nan if unknown."""
    pairs = np.column_stack((bodies[:, 0], links[:, 0], bodies[:, 1], links[:, 1]))
    keys, _, which = distinct_rows(pairs)
    known = [
        frictions.get((a, i, b, j), frictions.get((b, j, a, i), np.nan))
        for a, i, b, j in keys.tolist()
    ]
    return np.array(known, np.float64)[which]


def _along(vectors: Float64, axes: Float64) -> Float64:
    return np.asarray(np.einsum("ki,ki->k", vectors, axes))


def _across(vectors: Float64, axes: Float64) -> Float64:
    return np.asarray(vectors - _along(vectors, axes)[:, None] * axes)

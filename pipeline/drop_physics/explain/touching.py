"""Contact points as seen from each of the two bodies that touch."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.bodies import Records
from drop_physics.physics.impulses import Forces
from drop_physics.physics.on_links import contact_forces, points_force_n
from drop_physics.physics.rowed import Rowed
from drop_physics.physics.tree import BASE
from drop_physics.trace.states import Rows

STEPS = 1 << 40
"""A factor above the number of steps in any recording, so that body × STEPS + step is a unique key.
"""


@dataclass(frozen=True, eq=False)
class Sides(Rowed):
    """Contact points seen from one body at a time: two rows per point, ordered by step."""

    step: Int64
    """The sample after the step in which the contact existed."""
    body: Int64
    link: Int64
    other_body: Int64
    other_link: Int64
    is_a: Flags
    point: Int64
    """Row index of the contact point in the chunk."""
    row: Int64
    """Row index of this side among all sides of the chunk."""
    normal: Float64
    """Unit vector of the contact point, shape (k, 3), as the engine reports it."""
    rolling: Flags
    """Whether either link has a coefficient of rolling or spinning friction."""


@dataclass(frozen=True)
class Touches(Rowed):
    """The contact points of one link, one row each; vectors in world axes, (points, 3)."""

    step: Int64
    position_m: Float64
    """Point of application of the force on this link."""
    force_n: Float64
    """Sum of the normal force and both friction forces on this link."""
    distance_m: Float64
    """Distance of the bodies [m], negative if they overlap, (points,)."""
    other_body: Int64
    """Id of the other body, (points,)."""
    other_link: Int64

    def since(self, first: int, points: slice) -> Touches:
        """Return the selected points, with steps counted from step `first`."""
        some = self.at(points)
        return replace(some, step=some.step - first)


class Touching:
    """The contact points of a chunk, with the force on each of the bodies."""

    def __init__(self, contacts: Rows, records: Records, bodies: Collection[int]) -> None:
        step, a, b, link_a, link_b = (
            contacts[name] for name in ("step", "body_a", "body_b", "link_a", "link_b")
        )
        rolling = _rolls(records, step, a, link_a) | _rolls(records, step, b, link_b)
        body, link = (np.stack(each, axis=1) for each in ((a, b), (link_a, link_b)))
        held = np.flatnonzero(among(bodies, body.ravel()))
        order = held[np.argsort(body.ravel()[held], kind="stable")]
        points, is_a = order >> 1, (order & 1) == 0
        self.sides = Sides(
            step=step[points],
            body=body.ravel()[order],
            link=link.ravel()[order],
            other_body=body.ravel()[order ^ 1],
            other_link=link.ravel()[order ^ 1],
            is_a=is_a,
            point=points,
            row=np.arange(len(points)),
            normal=contacts["normal"][points],
            rolling=rolling[points],
        )
        self._distance_m = np.ascontiguousarray(contacts["distance_m"])
        friction_n = np.column_stack([contacts[name] for name in ("friction_1_n", "friction_2_n")])
        # Farther apart than contactProcessingThreshold, Bullet reports the friction of another
        # point.
        friction_n[(contacts["normal_force_n"] == 0) & (self._distance_m > 0)] = 0.0
        at_m = np.stack((contacts["position_a_m"], contacts["position_b_m"]), axis=1)
        self._forces = contact_forces(
            step=self.sides.step,
            link=self.sides.link,
            is_a=is_a,
            point_m=at_m.reshape(-1, 3)[order],
            force_n=points_force_n(
                contacts["normal"],
                contacts["normal_force_n"],
                friction_n,
                [contacts[f"friction_{which}_direction"] for which in (1, 2)],
            )[points],
            rolling=self.sides.rolling,
        )

    def of(self, bodies: Sequence[int], which: Int64, ends: Int64) -> tuple[Sides, Int64]:
        """Return the contact points of bodies in given steps, and the step of each by its index.

        `which` is the index of each step's body in `bodies`, `ends` the sample after each step,
        shape (n,); both ascend.
        """
        held = self.sides
        first, end = (np.searchsorted(held.body, bodies, side) for side in ("left", "right"))
        counts = end - first
        place = np.repeat(np.arange(len(bodies)), counts)
        points = np.arange(counts.sum()) + np.repeat(first - np.cumsum(counts) + counts, counts)
        found, rows = rows_of(place * STEPS + held.step[points], which * STEPS + ends)
        points = points[found]
        if len(points) and points[-1] - points[0] == len(points) - 1:  # as they lie, uncopied
            return held.at(slice(int(points[0]), int(points[-1]) + 1)), rows
        return held.at(points), rows

    def forces(self, sides: Sides, row: Int64) -> Forces:
        """Return the contact forces on the bodies; `row` is the index of each point's step."""
        rows: slice | Int64 = sides.row
        if len(row) and sides.row[-1] - sides.row[0] == len(row) - 1:
            rows = slice(int(sides.row[0]), int(sides.row[-1]) + 1)
        return replace(self._forces.at(rows), step=row)

    def touches(self, sides: Sides, forces: Forces) -> Touches:
        """Return contact points with forces, in the format for single-body laws."""
        return Touches(
            step=forces.step,
            position_m=forces.point_m,
            force_n=forces.force_n,
            distance_m=self.distance_m(sides),
            other_body=sides.other_body,
            other_link=sides.other_link,
        )

    def distance_m(self, sides: Sides) -> Float64:
        """Return the distance at contact points [m], negative if bodies overlap, shape (k,)."""
        return np.asarray(self._distance_m[sides.point])


def touches_of(contacts: Rows, body: int, link: int = BASE) -> Touches:
    """Return the contact points of one link of a body, in their order."""
    touching = Touching(contacts, Records(), [body])
    sides = touching.sides
    sides = sides.at(np.flatnonzero(sides.link == link))
    return touching.touches(sides, touching.forces(sides, sides.step))


def among(numbers: Collection[int], bodies: Int64) -> Flags:
    """Flag the bodies whose ids are among the given ones."""
    are = np.zeros(max([*numbers, int(bodies.max(initial=0))]) + 1, np.bool_)
    are[[*numbers]] = True
    return np.asarray((bodies >= 0) & are[bodies])


def _rolls(records: Records, step: Int64, body: Int64, link: Int64) -> Flags:
    """Flag the links with rolling or spinning friction in the given steps."""
    rolls = np.zeros(len(step), np.bool_)
    for name in ("rolling_friction", "spinning_friction"):
        if records.any(name):
            held = records.coefficients(name, step, body, link)
            rolls |= np.nan_to_num(held) != 0  # other engines report none
    return rolls


def rows_of(steps: Sequence[int] | Int64, ends: Int64) -> tuple[NDArray[np.intp], Int64]:
    """Flag the samples that occur in the sorted `ends`, and return their indices there."""
    asked = np.asarray(steps, np.int64)
    rows = np.minimum(np.searchsorted(ends, asked), len(ends) - 1)
    found = np.flatnonzero(ends[rows] == asked) if len(ends) else np.empty(0, np.intp)
    return found, rows[found] if len(ends) else np.empty(0, np.int64)

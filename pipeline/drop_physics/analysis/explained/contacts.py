"""The recorded contact points, and the forces on one part."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import polars as pl
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

Vector = tuple[str, str, str]
"""The columns of a vector in the world's axes."""
ON_A, ON_B = ("ax_m", "ay_m", "az_m"), ("bx_m", "by_m", "bz_m")
"""Where each body is touched."""
NORMAL = ("nx", "ny", "nz")
"""From b to a."""
FRICTION_1, FRICTION_2 = ("f1x", "f1y", "f1z"), ("f2x", "f2y", "f2z")
"""Directions of friction."""


@dataclass(frozen=True)
class Contacts:
    """Contact points of all bodies, one row each, in the order of the steps that they acted in.

    A point of step i acted in the step that led to sample i. Arrays have shape (points,).
    """

    table: pl.DataFrame
    """As recorded; a column is read where it is needed, since all of them take much memory."""

    @cached_property
    def step(self) -> Int64:
        """The step in which each acted."""
        return self.table["step"].to_numpy()

    @cached_property
    def body_a(self) -> Int64:
        """Number of one body."""
        return self.table["body_a"].to_numpy()

    @cached_property
    def link_a(self) -> Int64:
        """Its link; -1 is the base."""
        return self.table["link_a"].to_numpy()

    @cached_property
    def body_b(self) -> Int64:
        """Number of the other body."""
        return self.table["body_b"].to_numpy()

    @cached_property
    def link_b(self) -> Int64:
        """Its link."""
        return self.table["link_b"].to_numpy()

    @cached_property
    def distance_m(self) -> Float64:
        """Negative where they overlap."""
        return self.table["distance_m"].to_numpy()

    @cached_property
    def normal_force_n(self) -> Float64:
        """Along the normal, from b to a."""
        return self.table["normal_force_n"].to_numpy()

    def vector(self, names: Vector, row: int) -> Float64:
        """Return one vector of one point, world axes, shape (3,)."""
        return np.array(self.table.select(names).row(row))

    def of(self, body: int, link: int = -1) -> Touches:
        """Return the contact points of one part, and the forces on it."""
        rows, on_b = self._sides_of(body)
        its = np.where(on_b, self.link_b[rows], self.link_a[rows]) == link
        rows, is_a = rows[its], ~on_b[its]

        def column(name: str) -> Float64:
            return np.asarray(self.table[name].to_numpy()[rows])

        def force_n(normal: str, friction_1: str, friction_2: str) -> Float64:
            on_a = column(normal) * column("normal_force_n")
            on_a = on_a + column(friction_1) * column("friction_1_n")
            on_a = on_a + column(friction_2) * column("friction_2_n")
            return np.where(is_a, on_a, -on_a)

        on_each = zip(NORMAL, FRICTION_1, FRICTION_2, strict=True)
        points = zip(ON_A, ON_B, strict=True)
        return Touches(
            step=self.step[rows],
            position_m=np.stack([np.where(is_a, column(a), column(b)) for a, b in points], axis=1),
            force_n=np.stack([force_n(*names) for names in on_each], axis=1),
            distance_m=self.distance_m[rows],
            other_body=np.where(is_a, self.body_b[rows], self.body_a[rows]),
            other_link=np.where(is_a, self.link_b[rows], self.link_a[rows]),
        )

    def _sides_of(self, body: int) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Return the points of a body in order, and whether it is their body b."""
        bodies, rows, on_b = self._sides
        its = slice(*np.searchsorted(bodies, [body, body + 1]))
        return rows[its], on_b[its]

    @cached_property
    def _sides(self) -> tuple[Int64, NDArray[np.intp], NDArray[np.bool_]]:
        """Both sides of all points, by body and then in order."""
        bodies = np.stack((self.body_a, self.body_b), axis=1).ravel()
        order = np.argsort(bodies, kind="stable")
        return bodies[order], order // 2, order % 2 == 1


@dataclass(frozen=True)
class Touches:
    """The contact points of one part, one row each; vectors in world axes, (points, 3)."""

    step: Int64
    position_m: Float64
    """On this part."""
    force_n: Float64
    """Normal force and both frictions on this part."""
    distance_m: Float64
    """Negative where they overlap, (points,)."""
    other_body: Int64
    """The other body, (points,)."""
    other_link: Int64

    def at(self, points: slice | NDArray[np.bool_], step: Int64) -> Touches:
        """Return some of the points, with new step numbers."""
        return replace(
            self,
            step=step,
            **{
                name: getattr(self, name)[points]
                for name in ("position_m", "force_n", "distance_m", "other_body", "other_link")
            },
        )

"""The recorded contact points as arrays, and the forces on one part."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
import polars as pl
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]


@dataclass(frozen=True)
class Contacts:
    """Contact points of all bodies, one row each, in the order of the steps that they acted in.

    A point of step i acted in the step that led to sample i. Vectors have shape (points, 3) and
    world axes; the rest has shape (points,).
    """

    step: Int64
    body_a: Int64
    link_a: Int64
    body_b: Int64
    link_b: Int64
    position_a_m: Float64
    position_b_m: Float64
    normal: Float64
    """From b to a."""
    distance_m: Float64
    """Negative where they overlap."""
    normal_force_n: Float64
    friction_1_n: Float64
    friction_1_direction: Float64
    friction_2_n: Float64
    friction_2_direction: Float64

    def of(self, body: int, link: int = -1) -> Touches:
        """Return the contact points of one part, and the forces on it."""
        rows, on_b = self._sides_of(body)
        its = np.where(on_b, self.link_b[rows], self.link_a[rows]) == link
        rows, sign = rows[its], np.where(on_b[its], -1.0, 1.0)[:, None]
        force_n = (
            self.normal[rows] * self.normal_force_n[rows, None]
            + self.friction_1_direction[rows] * self.friction_1_n[rows, None]
            + self.friction_2_direction[rows] * self.friction_2_n[rows, None]
        )
        is_a = sign > 0
        position_m = np.where(is_a, self.position_a_m[rows], self.position_b_m[rows])
        other = np.where(is_a[:, 0], self.body_b[rows], self.body_a[rows])
        other_link = np.where(is_a[:, 0], self.link_b[rows], self.link_a[rows])
        return Touches(
            self.step[rows], position_m, sign * force_n, self.distance_m[rows], other, other_link
        )

    def _sides_of(self, body: int) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Return the points of a body in order, and whether it is their body b."""
        bodies, rows, on_b = self._sides
        its = slice(*np.searchsorted(bodies, [body, body + 1]))
        return rows[its], on_b[its]

    @cached_property
    def _sides(self) -> tuple[Int64, NDArray[np.intp], NDArray[np.bool_]]:
        """Both sides of all points, by body and then in order."""
        bodies = np.concatenate((self.body_a, self.body_b))
        rows = np.tile(np.arange(len(self.step)), 2)
        on_b = np.arange(len(bodies)) >= len(self.step)
        order = np.lexsort((on_b, rows, bodies))
        return bodies[order], rows[order], on_b[order]


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

    def at(self, points: NDArray[np.bool_], step: Int64) -> Touches:
        """Return some of the points, with new step numbers."""
        return replace(
            self,
            step=step,
            **{
                name: getattr(self, name)[points]
                for name in ("position_m", "force_n", "distance_m", "other_body", "other_link")
            },
        )


_VECTORS = {
    "position_a_m": ("ax_m", "ay_m", "az_m"),
    "position_b_m": ("bx_m", "by_m", "bz_m"),
    "normal": ("nx", "ny", "nz"),
    "friction_1_direction": ("f1x", "f1y", "f1z"),
    "friction_2_direction": ("f2x", "f2y", "f2z"),
}


def contacts_of(table: pl.DataFrame) -> Contacts:
    """Return a recording's table of contact points as arrays."""
    return Contacts(
        **{
            field.name: table.select(_VECTORS[field.name]).to_numpy()
            if field.name in _VECTORS
            else table[field.name].to_numpy()
            for field in fields(Contacts)
        }
    )

"""The recorded contact points as arrays, and what they do to one part."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

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
        """Return what pushes one part: its own points, and the forces on it."""
        on_a = (self.body_a == body) & (self.link_a == link)
        on_b = (self.body_b == body) & (self.link_b == link)
        rows = np.concatenate([np.flatnonzero(on_a), np.flatnonzero(on_b)])
        sign = np.repeat([1.0, -1.0], [np.sum(on_a), np.sum(on_b)])
        order = np.argsort(rows, kind="stable")
        rows, sign = rows[order], sign[order, None]
        force_n = (
            self.normal * self.normal_force_n[:, None]
            + self.friction_1_direction * self.friction_1_n[:, None]
            + self.friction_2_direction * self.friction_2_n[:, None]
        )
        is_a = sign > 0
        position_m = np.where(is_a, self.position_a_m[rows], self.position_b_m[rows])
        other = np.where(is_a[:, 0], self.body_b[rows], self.body_a[rows])
        other_link = np.where(is_a[:, 0], self.link_b[rows], self.link_a[rows])
        return Touches(self.step[rows], position_m, sign * force_n[rows], other, other_link)


@dataclass(frozen=True)
class Touches:
    """What pushes one part, one row per contact point; vectors in world axes, (points, 3)."""

    step: Int64
    position_m: Float64
    """Where on this part."""
    force_n: Float64
    """Normal force and both frictions, on this part."""
    other_body: Int64
    """What pushes, (points,)."""
    other_link: Int64

    def at(self, points: NDArray[np.bool_], step: Int64) -> Touches:
        """Return some of the points, with other numbers for their steps, in this order."""
        return replace(
            self,
            step=step,
            **{
                name: getattr(self, name)[points]
                for name in ("position_m", "force_n", "other_body", "other_link")
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

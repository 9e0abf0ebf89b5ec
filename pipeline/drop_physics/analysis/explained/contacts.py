"""The recorded contact points, and the forces on one part."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

ON_A, ON_B = ("ax_m", "ay_m", "az_m"), ("bx_m", "by_m", "bz_m")
"""Where each body is touched."""
NORMAL = ("nx", "ny", "nz")
"""From b to a."""
FRICTION_1, FRICTION_2 = ("f1x", "f1y", "f1z"), ("f2x", "f2y", "f2z")
"""Directions of friction."""


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


def touches_of(contacts: pl.DataFrame, body: int, link: int = -1) -> Touches:
    """Return the contact points of one part of a body, in their order; link -1 is its base."""
    on_a, on_b = (
        (pl.col(f"body_{side}") == body) & (pl.col(f"link_{side}") == link) for side in "ab"
    )
    its = contacts.filter(on_a | on_b).with_columns(on_a.alias("is_a"))
    is_a = its["is_a"].to_numpy()

    def column(name: str) -> Float64:
        return np.asarray(its[name].to_numpy())

    def force_n(normal: str, friction_1: str, friction_2: str) -> Float64:
        on_a = column(normal) * column("normal_force_n")
        on_a = on_a + column(friction_1) * column("friction_1_n")
        on_a = on_a + column(friction_2) * column("friction_2_n")
        return np.where(is_a, on_a, -on_a)

    on_each = zip(NORMAL, FRICTION_1, FRICTION_2, strict=True)
    points = zip(ON_A, ON_B, strict=True)
    return Touches(
        step=its["step"].to_numpy(),
        position_m=np.stack([np.where(is_a, column(a), column(b)) for a, b in points], axis=1),
        force_n=np.stack([force_n(*names) for names in on_each], axis=1),
        distance_m=column("distance_m"),
        other_body=np.where(is_a, its["body_b"].to_numpy(), its["body_a"].to_numpy()),
        other_link=np.where(is_a, its["link_b"].to_numpy(), its["link_a"].to_numpy()),
    )

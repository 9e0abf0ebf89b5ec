"""The recorded state as arrays, some samples in a row at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.explain.touching import Touches, touches_of
from drop_physics.physics.base import Motion
from drop_physics.trace.states import BASE, BODY, CONTACT, FLOOR
from drop_physics.trace.tables import rows_in

Float64 = NDArray[np.float64]
Flags = NDArray[np.bool_]

BLOCK = 1 << 13
"""Samples worked through at a time."""


@dataclass(frozen=True, eq=False)
class Samples(Motion):
    """Consecutive samples: the motion of the body, or of its base, and its floor contact."""

    first: int
    """Number of the first of them."""
    contact_points: NDArray[np.int16]
    """Number of contact points, shape (samples,)."""
    contact_distance_m: Float64
    """Their smallest distance to the floor [m], shape (samples,); nan without any."""
    pushed: Flags
    """Whether any of them pushed, shape (samples,)."""
    links: tuple[Motion, ...]
    """The other links of a body with joints, where recorded."""
    contacts: pl.DataFrame
    """The contact points of these samples."""

    @property
    def end(self) -> int:
        """Number of the sample after the last."""
        return self.first + len(self)

    @property
    def steps(self) -> NDArray[np.int64]:
        """Their numbers, shape (samples,)."""
        return np.arange(self.first, self.end)

    def times_s(self, timestep_s: float) -> Float64:
        """Return their times [s], shape (samples,)."""
        return np.arange(self.first, self.end, dtype=np.float64) * timestep_s

    @property
    def height_m(self) -> Float64:
        """Height of the centre [m], shape (samples,)."""
        return self.position_m[:, 2]

    @property
    def touching(self) -> Flags:
        """The samples that touch the floor: a contact pushed, or the shapes overlapped.

        A contact point alone is not a touch: Bullet keeps points up to 20 mm above the floor.
        """
        with np.errstate(invalid="ignore"):  # no contact, no distance
            return self.pushed | (self.contact_distance_m <= 0)

    @cached_property
    def touches(self) -> Touches:
        """The contact points of the body, or its base, with the rows of their samples."""
        touches = touches_of(rows_in(self.contacts, CONTACT), BODY)
        return touches.since(self.first, slice(None))


def samples_of(states: pl.DataFrame, contacts: pl.DataFrame) -> Samples:
    """Return consecutive samples as arrays: the body's motion, and how it touches the floor.

    Parameters
    ----------
    states
        One row per sample and part.
    contacts
        One row per contact point.
    """
    body = states.filter(pl.col("body") == BODY)
    base = motion_of(base_of(states))
    links = sorted(set(body["link"].unique()) - {BASE})
    first = int(states["step"].min() or 0)  # type: ignore[arg-type]
    points, distance_m, pushed = _contact(contacts, first, samples=len(base))
    return Samples(
        position_m=base.position_m,
        orientation=base.orientation,
        velocity_m_s=base.velocity_m_s,
        spin_rad_s=base.spin_rad_s,
        first=first,
        contact_points=points,
        contact_distance_m=distance_m,
        pushed=pushed,
        links=tuple(motion_of(body.filter(pl.col("link") == link)) for link in links),
        contacts=contacts,
    )


def samples_in(states: pl.DataFrame, contacts: pl.DataFrame) -> Iterator[Samples]:
    """Yield the samples of a drop's tables, some at a time."""
    last: int = states["step"].max()  # type: ignore[assignment]
    for first in range(0, last + 1, BLOCK):
        its = pl.col("step").is_between(first, first + BLOCK, closed="left")
        yield samples_of(states.filter(its), contacts.filter(its))


def base_of(states: pl.DataFrame) -> pl.DataFrame:
    """Return the rows of the body's base, one per sample."""
    return states.filter((pl.col("body") == BODY) & (pl.col("link") == BASE))


def _contact(
    contacts: pl.DataFrame, first: int, samples: int
) -> tuple[NDArray[np.int16], Float64, Flags]:
    """Return the number of points on the floor, their smallest distance [m], whether one pushed."""
    needed = contacts.select("step", "body_a", "body_b", "distance_m", "normal_force_n")
    pair = [BODY, FLOOR]
    touching = needed.filter(
        pl.col("body_a").is_in(pair),
        pl.col("body_b").is_in(pair),
        pl.col("body_a") != pl.col("body_b"),
    )
    points, distance_m = np.zeros(samples, np.int16), np.full(samples, np.nan)
    pushed = np.zeros(samples, np.bool_)
    rows = touching["step"].to_numpy() - first
    steps, begins, count = np.unique(rows, return_index=True, return_counts=True)
    if len(steps):
        points[steps] = count
        distance_m[steps] = np.minimum.reduceat(touching["distance_m"].to_numpy(), begins)
        pushed[rows[touching["normal_force_n"].to_numpy() > 0]] = True
    return points, distance_m, pushed


_POSITION, _ORIENTATION = ("x_m", "y_m", "z_m"), ("qx", "qy", "qz", "qw")
_VELOCITY, _SPIN = ("vx_m_s", "vy_m_s", "vz_m_s"), ("wx_rad_s", "wy_rad_s", "wz_rad_s")


def motion_of(states: pl.DataFrame) -> Motion:
    """Return the states of one part as arrays, a row per sample."""
    numbers = states.select(_POSITION + _ORIENTATION + _VELOCITY + _SPIN).to_numpy()
    return Motion(*(np.ascontiguousarray(part) for part in np.split(numbers, (3, 7, 10), axis=1)))

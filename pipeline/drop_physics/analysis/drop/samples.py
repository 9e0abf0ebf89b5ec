"""The recorded state as arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.laws.base import Motion
from drop_physics.states import BASE, BODY, FLOOR

Float64 = NDArray[np.float64]

BLOCK = 1 << 16
"""Samples worked through at a time."""


@dataclass(frozen=True)
class Samples(Motion):
    """The recorded state: the motion of the body, or of its base, and its floor contact."""

    contact_points: NDArray[np.int16]
    """Number of contact points, shape (samples,)."""
    contact_distance_m: Float64
    """Their smallest distance to the floor [m], shape (samples,); nan without any."""
    pushed: NDArray[np.bool_]
    """Whether any of them pushed, shape (samples,)."""
    links: tuple[Motion, ...] = ()
    """The other links of a body with joints, where recorded."""

    @classmethod
    def gathered(cls, parts: Iterable[Samples], most: int) -> Samples:
        """Return consecutive samples as one; each part may be freed before the next is made.

        `most`: at least their number.
        """
        whole, end = None, 0
        for part in parts:
            whole = whole or part._each(
                lambda values: np.empty((most, *values.shape[1:]), values.dtype)
            )
            rows, end = slice(end, end + len(part)), end + len(part)
            for mine, its in zip((whole, *whole.links), (part, *part.links), strict=True):
                for each in fields(type(mine)):
                    if each.name != "links":
                        getattr(mine, each.name)[rows] = getattr(its, each.name)
        assert whole is not None
        return whole if end == most else whole._each(lambda values: values[:end])

    def _each(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Samples:
        """Return the same with all arrays changed."""

        def changed(motion: Motion) -> dict[str, NDArray[Any]]:
            names = [each.name for each in fields(motion) if each.name != "links"]
            return {name: change(getattr(motion, name)) for name in names}

        return Samples(**changed(self), links=tuple(Motion(**changed(link)) for link in self.links))

    @property
    def height_m(self) -> Float64:
        """Height of the centre [m], shape (samples,)."""
        return self.position_m[:, 2]


def samples_of(states: pl.DataFrame, contacts: pl.DataFrame) -> Samples:
    """Return a recording's tables as arrays: the body's motion, and how it touches the floor.

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
    points, distance_m, pushed = _contact(contacts, samples=len(base.position_m))
    return Samples(
        position_m=base.position_m,
        orientation=base.orientation,
        velocity_m_s=base.velocity_m_s,
        spin_rad_s=base.spin_rad_s,
        contact_points=points,
        contact_distance_m=distance_m,
        pushed=pushed,
        links=tuple(motion_of(body.filter(pl.col("link") == link)) for link in links),
    )


def blocks(end: int, first: int = 0) -> Iterator[slice]:
    """Yield consecutive samples, few enough that a million do not take much memory."""
    for begin in range(first, end, BLOCK):
        yield slice(begin, min(begin + BLOCK, end))


def base_of(states: pl.DataFrame) -> pl.DataFrame:
    """Return the rows of the body's base, one per sample."""
    return states.filter((pl.col("body") == BODY) & (pl.col("link") == BASE))


def _contact(
    contacts: pl.DataFrame, samples: int
) -> tuple[NDArray[np.int16], Float64, NDArray[np.bool_]]:
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
    steps, first, count = np.unique(
        touching["step"].to_numpy(), return_index=True, return_counts=True
    )
    if len(steps):
        points[steps] = count
        distance_m[steps] = np.minimum.reduceat(touching["distance_m"].to_numpy(), first)
        pushed[touching["step"].to_numpy()[touching["normal_force_n"].to_numpy() > 0]] = True
    return points, distance_m, pushed


_POSITION, _ORIENTATION = ("x_m", "y_m", "z_m"), ("qx", "qy", "qz", "qw")
_VELOCITY, _SPIN = ("vx_m_s", "vy_m_s", "vz_m_s"), ("wx_rad_s", "wy_rad_s", "wz_rad_s")


def motion_of(states: pl.DataFrame) -> Motion:
    """Return the states of one part as arrays, a row per sample."""
    numbers = states.select(_POSITION + _ORIENTATION + _VELOCITY + _SPIN).to_numpy()
    return Motion(*(np.ascontiguousarray(part) for part in np.split(numbers, (3, 7, 10), axis=1)))

"""The recorded states as arrays of consecutive samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.touching import Touches, touches_of
from drop_physics.physics.base import Motion
from drop_physics.trace.history import Piece, Seen
from drop_physics.trace.states import BASE, BODY, FLOOR, MOTION, STATE, Rows


@dataclass(frozen=True, eq=False)
class DropSamples(Motion):
    """Consecutive samples: the motion of the body or, with joints, of its base; and its contact."""

    first: int
    """Index of the first sample."""
    contact_points: NDArray[np.int16]
    """Number of contact points, shape (samples,)."""
    contact_distance_m: Float64
    """Smallest distance of the contact points to the floor [m], shape (samples,); nan without
    any."""
    pushed: Flags
    """Whether any contact point had a positive normal force, shape (samples,)."""
    links: tuple[Motion, ...]
    """States of the other links of a body with joints, if recorded."""
    contacts: Rows
    """The contact points of these samples."""

    @property
    def end(self) -> int:
        """Index after the last sample."""
        return self.first + len(self)

    @property
    def steps(self) -> Int64:
        """Indices of the samples, shape (samples,)."""
        return np.arange(self.first, self.end)

    def times_s(self, timestep_s: float) -> Float64:
        """Return the times of the samples [s], shape (samples,)."""
        return np.arange(self.first, self.end, dtype=np.float64) * timestep_s

    @property
    def height_m(self) -> Float64:
        """Height of the centre [m], shape (samples,)."""
        return self.position_m[:, 2]

    @property
    def touching(self) -> Flags:
        """Flags the samples that touch the floor: a contact pushed, or the shapes overlapped.

        A contact point alone is not a touch: Bullet keeps points up to 20 mm above the floor.
        """
        with np.errstate(invalid="ignore"):  # no contact, no distance
            return self.pushed | (self.contact_distance_m <= 0)

    @cached_property
    def touches(self) -> Touches:
        """The contact points of the body or its base, with the rows of their samples."""
        return touches_of(self.contacts, BODY).since(self.first, slice(None))


def samples_seen(seen: Seen, piece: Piece) -> DropSamples:
    """Return a chunk's samples as arrays: the body's motion, and its floor contact."""
    parts, contacts = seen.parts_of(piece), piece.contacts
    states = parts.get((BODY, BASE), np.empty(0, STATE))
    base = _motion_of(states)
    first = int(states["step"][0]) if len(states) else 0
    points, distance_m, pushed = _contact(contacts, first, samples=len(base))
    return DropSamples(
        position_m=base.position_m,
        orientation=base.orientation,
        velocity_m_s=base.velocity_m_s,
        spin_rad_s=base.spin_rad_s,
        first=first,
        contact_points=points,
        contact_distance_m=distance_m,
        pushed=pushed,
        links=tuple(
            _motion_of(parts[key]) for key in sorted(parts) if key[0] == BODY and key[1] != BASE
        ),
        contacts=contacts,
    )


def _contact(contacts: Rows, first: int, samples: int) -> tuple[NDArray[np.int16], Float64, Flags]:
    """Return the number of floor contacts, their smallest distance [m], and whether any pushed."""
    a, b = contacts["body_a"], contacts["body_b"]
    touching = contacts[np.isin(a, (BODY, FLOOR)) & np.isin(b, (BODY, FLOOR)) & (a != b)]
    points, distance_m = np.zeros(samples, np.int16), np.full(samples, np.nan)
    pushed = np.zeros(samples, np.bool_)
    rows = touching["step"] - first
    steps, begins, count = np.unique(rows, return_index=True, return_counts=True)
    if len(steps):
        points[steps] = count
        distance_m[steps] = np.minimum.reduceat(touching["distance_m"], begins)
        pushed[rows[touching["normal_force_n"] > 0]] = True
    return points, distance_m, pushed


def _motion_of(states: Rows) -> Motion:
    """Return the states of one part as arrays, one row per sample."""
    return Motion(*(np.ascontiguousarray(states[name]) for name in MOTION))

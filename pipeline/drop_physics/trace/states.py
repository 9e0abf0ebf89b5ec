"""Types of the data that an engine reports for each step: states of movable bodies, contact points.

Both are rows of named numbers. A *part* is a link of a body; link -1 is the base. All vectors are
in world axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64, Int64
from drop_physics.physics.rowed import Rowed
from drop_physics.physics.vectors import groups

Rows = NDArray[np.void]
"""Rows of `STATE` or of `CONTACT`, in the order of their steps."""

BODY, FLOOR = 0, 1
"""Body ids of the two bodies of a drop."""
BODY_LABEL, FLOOR_LABEL = "box", "floor"
"""The bodies' labels in the recording of a drop."""
BASE = -1
"""Link index of the base, which every body has."""

STATE = np.dtype(
    [
        ("step", "<i8"),
        ("body", "<i8"),
        ("link", "<i8"),
        ("position_m", "<f8", (3,)),
        ("orientation", "<f8", (4,)),
        ("velocity_m_s", "<f8", (3,)),
        ("spin_rad_s", "<f8", (3,)),
    ]
)
"""State of one part at a sample: position of its centre of mass [m], and orientation of its axes as
a quaternion x, y, z, w. The parts of a step are ordered by body and link."""

BASE_STATE = np.dtype([(name, STATE[name]) for name in STATE.names or () if name != "link"])
"""The state of a base: that of a part without the link index."""

MOTION = {
    "position_m": slice(0, 3), "orientation": slice(3, 7), "velocity_m_s": slice(7, 10),
    "spin_rad_s": slice(10, 13),
}  # fmt: skip
"""Slices of a state's 13 numbers: position, orientation, linear and angular velocity."""
STATE_COLUMNS = {
    "position_m": ("x_m", "y_m", "z_m"),
    "orientation": ("qx", "qy", "qz", "qw"),
    "velocity_m_s": ("vx_m_s", "vy_m_s", "vz_m_s"),
    "spin_rad_s": ("wx_rad_s", "wy_rad_s", "wz_rad_s"),
}
"""The table columns of each part of a state."""
MOTION_COLUMNS = [name for names in STATE_COLUMNS.values() for name in names]

CONTACT = np.dtype(
    [
        ("step", "<i8"),
        ("body_a", "<i8"),
        ("link_a", "<i8"),
        ("body_b", "<i8"),
        ("link_b", "<i8"),
        ("position_a_m", "<f8", (3,)),
        ("position_b_m", "<f8", (3,)),
        ("normal", "<f8", (3,)),
        ("distance_m", "<f8"),
        ("normal_force_n", "<f8"),
        ("friction_1_n", "<f8"),
        ("friction_1_direction", "<f8", (3,)),
        ("friction_2_n", "<f8"),
        ("friction_2_direction", "<f8", (3,)),
    ]
)
"""A contact point of the step before sample `step`: two parts, the point on each [m], the normal
from b to a, the distance [m] (negative: penetration), and the forces on a [N]. The points of a step
are in the engine's order."""

CONTACT_COLUMNS = {
    "position_a_m": ("ax_m", "ay_m", "az_m"),
    "position_b_m": ("bx_m", "by_m", "bz_m"),
    "normal": ("nx", "ny", "nz"),
    "friction_1_direction": ("f1x", "f1y", "f1z"),
    "friction_2_direction": ("f2x", "f2y", "f2z"),
}
"""The table columns of each vector of a contact point."""


@dataclass(frozen=True)
class Joints(Rowed):
    """The movable joints of a body at n samples."""

    steps: Int64
    times_s: Float64
    position: Float64
    """Joint positions [rad] or [m], shape (n, positions)."""
    velocity: Float64
    """Joint velocities [rad/s] or [m/s], shape (n, velocities)."""
    effort: Float64
    """Motor efforts [N m] or [N], shape (n, efforts)."""


def in_step_order(rows: Rows) -> Rows:
    """Return the rows sorted by step, without a copy if they already are."""
    steps = rows["step"]
    if (steps[1:] >= steps[:-1]).all():
        return rows
    ordered: Rows = rows[np.argsort(steps, kind="stable")]
    return ordered


def between(rows: Rows, first: int, end: int) -> Rows:
    """Return the rows of the steps from `first` to before `end`; rows are in step order."""
    some: Rows = rows[slice(*np.searchsorted(rows["step"], (first, end)))]
    return some


def motion_of(rows: Rows) -> Float64:
    """Return the 13 numbers of each state, in the layout of `MOTION`: shape (n, 13)."""
    flat = np.ascontiguousarray(rows).view(np.float64)
    return np.asarray(flat.reshape(len(rows), rows.dtype.itemsize // 8)[:, -13:])


def numbers_of(rows: Rows, field: str) -> NDArray[np.float64 | np.int64]:
    """Return a field of rows as a 2-D array, even if it has one number: shape (n, k)."""
    values: NDArray[np.float64 | np.int64] = rows[field]
    return values[:, None] if values.ndim == 1 else values


def by_body(rows: Rows) -> dict[int, Rows]:
    """Return each body's states in order, keyed by body id."""
    return {number: rows[its] for number, its in groups(rows["body"])}


def poses_of(states: Rows) -> Float64:
    """Return position [m] and orientation (quaternion x, y, z, w) of states, shape (n, 7)."""
    return np.hstack((states["position_m"], states["orientation"]))

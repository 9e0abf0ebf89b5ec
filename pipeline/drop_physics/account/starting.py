"""Describes the pose with which a body or a joint starts, as far as it is remarkable."""

from __future__ import annotations

import numpy as np

from drop_physics.account.names import main_axis
from drop_physics.arrays import Float64
from drop_physics.messages import Message, joined
from drop_physics.physics.rotations import products, rotate, rotation_vectors
from drop_physics.quantities import number, quantity
from drop_physics.trace.events import Joint

UPRIGHT = np.array([[0.0, 0.0, 0.0, 1.0]])
LEAST_RAD = 0.02
"""Angle below which a start orientation counts as that of the model file [rad]."""
ALONG = 0.999
"""Cosine above which a rotation counts as about one of the world's axes."""
ROUND = 1e-6
"""Distance from the end of a range below which a position counts as inside [rad] or [m]."""


INVERSE = np.array([-1.0, -1.0, -1.0, 1.0])
"""Signs that make a unit quaternion x, y, z, w its inverse."""


def base_at_start(orientation: Float64, frame: Float64 | None) -> Float64 | None:
    """Return the orientation of a base's own axes in the world, shape (4,); None if unknown.

    `orientation` is that of the base's inertia in the world, and `frame` that of the inertia in the
    base: unit quaternions x, y, z, w, shape (4,).
    """
    if frame is None or not frame.any() or not np.isfinite(frame).all():
        return None
    return np.asarray(products(orientation[None], (frame * INVERSE)[None])[0])


def turned_at_start(base: Float64 | None, *, w_first: bool) -> Message:
    """Describe the rotation with which a floating base starts; nothing if that is negligible.

    `base` is the orientation as of `base_at_start`. `w_first` says whether the engine's quaternions
    begin with w.
    """
    if base is None:
        return Message("")
    turned = rotation_vectors(UPRIGHT, base[None])[0]
    angle = float(np.linalg.norm(turned))
    if angle < LEAST_RAD:
        return Message("")
    axis = turned / angle
    about: str = main_axis(axis)
    if np.abs(axis).max() < ALONG:
        about = f"({joined(', ', [number(float(each)) for each in axis])})"
    told = Message(
        "; it starts turned by {angle}° about {axis}",
        angle=number(float(np.degrees(angle))),
        axis=about,
    )
    return told + _in_other_order(base, w_first=w_first)


def _in_other_order(base: Float64, *, w_first: bool) -> Message:
    """Describe half a turn as its quaternion reads with w at the other end, or nothing.

    A turn about an axis of the world that is written in the wrong order becomes half a turn about
    an axis between two others.
    """
    x, y, z, w = base
    other = np.array([0.0, x, y, z] if w_first else [y, z, 0.0, x])
    turned = rotation_vectors(UPRIGHT, other[None])[0]
    angle, parts = float(np.linalg.norm(turned)), np.abs(base[:3])
    if abs(w) > ROUND or parts.max() > ALONG or angle < LEAST_RAD:
        return Message("")
    if np.abs(turned).max() < ALONG * angle:
        return Message("")
    told = {"angle": number(float(np.degrees(angle))), "axis": main_axis(turned / angle)}
    if w_first:
        return Message(
            ": the engine takes w first; with w last the same numbers are {angle}° about {axis}",
            **told,
        )
    return Message(
        ": the engine takes w last; with w first the same numbers are {angle}° about {axis}", **told
    )


def spins_at_start(base: Float64 | None, spin_rad_s: Float64) -> Message:
    """Describe an initial angular velocity in both frames, if the base starts turned; else nothing.

    `spin_rad_s` is in world axes, shape (3,).
    """
    if base is None or np.linalg.norm(rotation_vectors(UPRIGHT, base[None])[0]) < LEAST_RAD:
        return Message("")
    own = rotate((base * INVERSE)[None], spin_rad_s[None])[0]
    least = LEAST_RAD * float(np.linalg.norm(spin_rad_s))
    if np.abs(own - spin_rad_s).max() <= least:
        return Message("")
    its, worlds = (
        joined(", ", [number(float(each) if abs(each) > least else 0.0) for each in axes])
        for axes in (own, spin_rad_s)
    )
    return Message(
        ", ({own}) rad/s in its own axes and ({world}) rad/s in the world's", own=its, world=worlds
    )


def pushed_askew(base: Float64 | None, push: Float64) -> Message:
    """Describe a push along an axis of the world in the axes of a body that starts turned.

    `push` is the sum of the applied impulses, in world axes, shape (3,). Nothing is said of a push
    in another direction, or along the same axis of the body.
    """
    size = float(np.linalg.norm(push))
    if base is None or not size or np.abs(push).max() < ALONG * size:
        return Message("")
    own = rotate((base * INVERSE)[None], push[None] / size)[0]
    if np.abs(own - push / size).max() < LEAST_RAD:
        return Message("")
    return Message(
        "; the applied force is along the world's {axis} on the whole, at the start ({own}) in its "
        "own axes",
        axis=main_axis(push),
        own=joined(", ", [number(float(np.round(each, 3)) + 0.0) for each in own]),
    )


def starts_beyond(joint: Joint, start: float, unit: str) -> Message:
    """Describe the range of a joint that starts outside it; nothing if it starts within."""
    low, high = joint.limits
    if high < low or low - ROUND <= start <= high + ROUND:
        return Message("")
    return Message(
        "; it starts beyond its range of {low} to {high}",
        low=quantity(low, unit),
        high=quantity(high, unit),
    )

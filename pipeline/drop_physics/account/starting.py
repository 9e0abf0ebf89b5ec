"""Describes the pose with which a body or a joint starts, as far as it is remarkable."""

from __future__ import annotations

import numpy as np

from drop_physics.account.names import main_axis
from drop_physics.arrays import Float64
from drop_physics.messages import Message, joined
from drop_physics.physics.rotations import products, rotation_vectors
from drop_physics.quantities import number, quantity
from drop_physics.trace.events import Joint

UPRIGHT = np.array([[0.0, 0.0, 0.0, 1.0]])
LEAST_RAD = 0.02
"""Angle below which a start orientation counts as that of the model file [rad]."""
ALONG = 0.999
"""Cosine above which a rotation counts as about one of the world's axes."""
ROUND = 1e-6
"""Distance from the end of a range below which a position counts as inside [rad] or [m]."""


def turned_at_start(orientation: Float64, frame: Float64 | None) -> Message:
    """Describe the rotation with which a floating base starts; nothing if that is negligible.

    `orientation` is that of the base's inertia in the world, and `frame` that of the inertia in the
    base: unit quaternions x, y, z, w, shape (4,); `frame` is None if unknown.
    """
    if frame is None or not frame.any() or not np.isfinite(frame).all():
        return Message("")
    base = products(orientation[None], (frame * [-1.0, -1.0, -1.0, 1.0])[None])
    turned = rotation_vectors(UPRIGHT, base)[0]
    angle = float(np.linalg.norm(turned))
    if angle < LEAST_RAD:
        return Message("")
    axis = turned / angle
    about: str = main_axis(axis)
    if np.abs(axis).max() < ALONG:
        about = f"({joined(', ', [number(float(each)) for each in axis])})"
    return Message(
        "; it starts turned by {angle}° about {axis}",
        angle=number(float(np.degrees(angle))),
        axis=about,
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

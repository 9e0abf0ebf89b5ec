"""Orientation of a body: flat, as the contact law requires, or tilted.

`turned` are orientations, quaternions x, y, z, w of shape (n, 4).
"""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.drop.case import DropCase
from drop_physics.physics.rotations import rotate, rotate_inverse
from drop_physics.physics.vectors import cross, lengths, sums

FLAT_RAD = 5e-3
"""Largest tilt at which a body counts as flat [rad]. With all four corners in contact, the contact
law reproduced 500 rebounds to 1.2e-4 of the approach speed up to this tilt; beyond it, corners land
one by one (`tests/test_contact_law.py`)."""
SMALL_RAD = 1e-4
"""Tilt [rad] that moves the centre of a small body by at most the contact slop."""
_UP = np.array([[0.0, 0.0, 1.0]])


def up_in_body(turned: Float64) -> Float64:
    """Return the world's up axis in the body's axes, unit vectors, shape (n, 3)."""
    return rotate_inverse(turned, np.broadcast_to(_UP, (len(turned), 3)))


def turned_rad(case: DropCase, turned: Float64) -> Float64:
    """Return the tilt of a body relative to its release [rad], shape (n,).

    A rotation about the vertical is not a tilt, and a ball is never tilted.
    """
    if case.is_ball:
        return np.zeros(len(turned))
    return _angle(up_in_body(turned), up_in_body(case.start.orientation))


def tilt_rad(case: DropCase, turned: Float64) -> Float64:
    """Return the tilt of a body relative to the posture that the contact law assumes [rad], (n,).

    A box is untilted on any of its faces, any other body in its orientation at release.
    """
    return _from_a_face(_up_in_box(case, turned)) if case.is_box else turned_rad(case, turned)


def _from_a_face(up: Float64) -> Float64:
    """Return the angle between unit vectors in a box's axes and the nearest axis [rad], (n,)."""
    nearest = np.zeros_like(up)
    axes = np.abs(up).argmax(axis=1)
    rows = np.arange(len(up))
    nearest[rows, axes] = np.sign(up[rows, axes])
    return _angle(up, nearest)


def flat_height_m(case: DropCase) -> float | None:
    """Return the centre's height for a body lying in its final posture [m].

    None if the body is tilted, or the height is unknown.
    """
    turned = case.end.orientation
    if tilt_rad(case, turned)[0] > SMALL_RAD:
        return None
    if not case.is_box:
        return case.engine.rest_height_m
    if not _has_sharp_faces(case):
        return case.engine.rest_height_m if turned_rad(case, turned)[0] <= SMALL_RAD else None
    axis, sign = face_up(case, turned)
    offset_m = case.engine.shape_position_m or (0.0, 0.0, 0.0)
    up = rotate(_shape_orientation(case), sign * np.eye(3)[axis : axis + 1])[0]
    return case.engine.shape_dimensions_m[axis] / 2 - float(up @ np.array(offset_m))


def stands(case: DropCase) -> bool:
    """Return whether a box has its centre of mass above its lowest face; otherwise it topples."""
    position_m = np.array([case.engine.shape_position_m or (0.0, 0.0, 0.0)])
    offset_m = rotate_inverse(_shape_orientation(case), position_m)[0]
    axis, _ = face_up(case, case.start.orientation)
    inside = np.abs(offset_m) < np.array(case.engine.shape_dimensions_m) / 2
    return bool(np.delete(inside, axis).all())


def extent_m(case: DropCase) -> float | None:
    """Return the height of a box or ball as released [m]; None for other bodies."""
    if case.is_ball:
        return 2 * case.engine.shape_dimensions_m[0]
    if not case.is_box or not _has_sharp_faces(case):
        return None
    up = np.abs(_up_in_box(case, case.start.orientation)[0])
    return float(up @ np.array(case.engine.shape_dimensions_m))


def _has_sharp_faces(case: DropCase) -> bool:
    """Return whether a box has exact faces for contact; in Bullet, a tiny box does not."""
    if case.engine.rest_height_m is None or case.engine.shape_position_m is None:
        return False
    turned = case.start.orientation
    half_m = np.abs(_up_in_box(case, turned)[0]) @ np.array(case.engine.shape_dimensions_m) / 2
    offset_m = float(up_in_body(turned)[0] @ np.array(case.engine.shape_position_m))
    return abs(float(half_m) - offset_m - case.engine.rest_height_m) < 1e-9


def _shape_orientation(case: DropCase) -> Float64:
    return np.array([case.engine.shape_orientation or (0.0, 0.0, 0.0, 1.0)])


def _up_in_box(case: DropCase, turned: Float64) -> Float64:
    up = up_in_body(turned)
    return rotate_inverse(np.broadcast_to(_shape_orientation(case), (len(up), 4)), up)


def face_up(case: DropCase, turned: Float64) -> tuple[int, float]:
    """Return the axis of a box that is nearest to the vertical, and whether it points up.

    `turned` is one orientation, shape (1, 4).
    """
    up = _up_in_box(case, turned)[0]
    axis = int(np.abs(up).argmax())
    return axis, float(np.sign(up[axis]))


def _angle(a: Float64, b: Float64) -> Float64:
    """Return the angle between unit vectors [rad], accurate for small angles, unlike acos."""
    across = lengths(cross(a, b))
    return np.asarray(np.arctan2(across, sums(a * b)))

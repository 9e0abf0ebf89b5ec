"""How a body is oriented: whether it touches the floor as the contact law assumes, or tumbles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.drop.case import Case
from drop_physics.analysis.drop.samples import blocks
from drop_physics.laws.rotations import rotate, rotate_inverse
from drop_physics.laws.vectors import cross, lengths, sums

Float64 = NDArray[np.float64]

FLAT_RAD = 5e-3
"""Tilt up to which a body counts as flat: up to it, with all four corners in contact, the contact
law reproduced 500 rebounds to 1.2e-4 of the approach; beyond it corners land one by one
(`tests/test_contact_law.py`)."""
SMALL_RAD = 1e-4
"""Tilt that moves the centre of a small body by no more than the contact slop."""
_UP = np.array([[0.0, 0.0, 1.0]])
_ALL = slice(None)


def up_in_body(case: Case, samples: slice = _ALL) -> Float64:
    """Return the world's up axis in the body's axes, unit vectors, shape (samples, 3)."""
    orientation = case.samples.orientation[samples]
    return rotate_inverse(orientation, np.broadcast_to(_UP, (len(orientation), 3)))


def turned_rad(case: Case, samples: slice = _ALL) -> Float64:
    """Return how far each sample is tilted from the release [rad], shape (samples,).

    Turning about the vertical is not a tilt. A ball is never tilted.
    """
    if case.is_ball:
        return np.zeros(len(range(*samples.indices(len(case.samples)))))
    released = up_in_body(case, slice(1))
    return _joined(_angle(up_in_body(case, rows), released) for rows in _blocks(case, samples))


def tilt_rad(case: Case, samples: slice = _ALL) -> Float64:
    """Return how far each sample is tilted from what the contact law assumes [rad], (samples,).

    A box is flat on any of its faces, any other body as it was released.
    """
    if not case.is_box:
        return turned_rad(case, samples)
    return _joined(_from_a_face(_up_in_box(case, rows)) for rows in _blocks(case, samples))


def _from_a_face(up: Float64) -> Float64:
    """Return the angle between unit vectors in a box and its nearest axis [rad], (n,)."""
    nearest = np.zeros_like(up)
    axes = np.abs(up).argmax(axis=1)
    rows = np.arange(len(up))
    nearest[rows, axes] = np.sign(up[rows, axes])
    return _angle(up, nearest)


def _blocks(case: Case, samples: slice) -> Iterator[slice]:
    first, end, _ = samples.indices(len(case.samples))
    return blocks(end, first)


def _joined(parts: Iterable[Float64]) -> Float64:
    return np.concatenate([np.empty(0), *parts])


def tumbled_step(case: Case, touching: NDArray[np.bool_]) -> int | None:
    """Return the first sample that touches the floor tilted; None where none does.

    Where not every touch is reported, all samples from the first touch on count as touching.
    """
    if not case.is_rigid:
        return None
    if case.hides_contacts:
        touching = np.logical_or.accumulate(touching)
    tumbling = np.flatnonzero(touching & (tilt_rad(case) > FLAT_RAD))
    return int(tumbling[0]) if len(tumbling) else None


def tumbles(case: Case, step: int) -> bool:
    """Whether a body that touches the floor tilted at a sample turns from there on."""
    return float(np.ptp(tilt_rad(case, slice(step, None)))) > FLAT_RAD


def flat_height_m(case: Case, step: int) -> float | None:
    """Return the height of the centre of a body that lies as it does in a sample [m].

    None where the body is tilted, or the height is unknown.
    """
    sample = slice(step, step + 1)
    if tilt_rad(case, sample)[0] > SMALL_RAD:
        return None
    if not case.is_box:
        return case.engine.rest_height_m
    if not _has_sharp_faces(case):
        return case.engine.rest_height_m if turned_rad(case, sample)[0] <= SMALL_RAD else None
    axis, sign = face_up(case, step)
    offset_m = case.engine.shape_position_m or (0.0, 0.0, 0.0)
    up = rotate(_shape_orientation(case), sign * np.eye(3)[axis : axis + 1])[0]
    return case.engine.shape_dimensions_m[axis] / 2 - float(up @ np.array(offset_m))


def stands(case: Case) -> bool:
    """Whether a box is released with its centre of mass above its lowest face; else it topples."""
    position_m = np.array([case.engine.shape_position_m or (0.0, 0.0, 0.0)])
    offset_m = rotate_inverse(_shape_orientation(case), position_m)[0]
    axis, _ = face_up(case, 0)
    inside = np.abs(offset_m) < np.array(case.engine.shape_dimensions_m) / 2
    return bool(np.delete(inside, axis).all())


def extent_m(case: Case) -> float | None:
    """Return the height of a box or ball as released [m]; None for other bodies."""
    if case.is_ball:
        return 2 * case.engine.shape_dimensions_m[0]
    if not case.is_box or not _has_sharp_faces(case):
        return None
    return float(np.abs(_up_in_box(case, slice(1))[0]) @ np.array(case.engine.shape_dimensions_m))


def _has_sharp_faces(case: Case) -> bool:
    """Whether a box touches where its dimensions say: in Bullet one below a few mm does not."""
    if case.engine.rest_height_m is None or case.engine.shape_position_m is None:
        return False
    half_m = np.abs(_up_in_box(case, slice(1))[0]) @ np.array(case.engine.shape_dimensions_m) / 2
    offset_m = float(up_in_body(case, slice(1))[0] @ np.array(case.engine.shape_position_m))
    return abs(float(half_m) - offset_m - case.engine.rest_height_m) < 1e-9


def _shape_orientation(case: Case) -> Float64:
    return np.array([case.engine.shape_orientation or (0.0, 0.0, 0.0, 1.0)])


def _up_in_box(case: Case, samples: slice = _ALL) -> Float64:
    up = up_in_body(case, samples)
    return rotate_inverse(np.broadcast_to(_shape_orientation(case), (len(up), 4)), up)


def face_up(case: Case, step: int) -> tuple[int, float]:
    """Return the axis of a box that is nearest to the vertical, and its sign there."""
    up = _up_in_box(case, slice(step, step + 1))[0]
    axis = int(np.abs(up).argmax())
    return axis, float(np.sign(up[axis]))


def _angle(a: Float64, b: Float64) -> Float64:
    """Return the angle between unit vectors [rad]; exact for small ones, where acos is not."""
    across = lengths(cross(a, b))
    return np.asarray(np.arctan2(across, sums(a * b)))

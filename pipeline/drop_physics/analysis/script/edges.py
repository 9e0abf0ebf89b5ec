"""How thick a part is, from the box around it in world axes and the shape that is drawn of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drop_physics.laws.rotations import matrix
from drop_physics.seen.events import Body, Shape
from drop_physics.states import BASE

Float64 = NDArray[np.float64]

MARGINS_M = (0.0, 2e-3)
"""How much longer Bullet's box around a shape is: by twice 1 mm beside the centre of mass."""
ROUNDED = 1e-6
"""Share of a part's longest edge that is rounding."""


def box_m(body: Body, link: int) -> Float64:
    """Return the edges of the box around a part in world axes, (3,); 0 if it has no shape."""
    bounds = body.bounds_m[6 * (link + 1) : 6 * (link + 2)]
    return np.subtract(bounds[3:], bounds[:3]) if len(bounds) == 6 else np.zeros(3)


def edges_of(body: Body, link: int, orientation: Sequence[float] | None) -> Float64 | None:
    """Return the edges of the box around a part along its own axes, (3,); None where unknown.

    Parameters
    ----------
    body, link
        The part, as it appeared.
    orientation
        Its orientation then, a quaternion x, y, z, w; None if unknown.
    """
    around_m = box_m(body, link)
    if orientation is None or not (around_m > 0).all():
        return None
    edges_m = _drawn_edges(body, link, orientation)
    if edges_m is None and _right_angled(matrix(orientation)):
        return around_m
    return edges_m


def corners_of(body: Body, orientation: Sequence[float] | None) -> tuple[Float64, Float64] | None:
    """Return the lowest and the highest corner of a body that fills the box around it.

    That is one box along the world's axes, or a plane that is not turned.
    """
    if orientation is None or len(body.shapes) != 1 or len(body.bounds_m) != 6:
        return None
    (shape,), turn = body.shapes, matrix(orientation)
    low_m, high_m = np.reshape(body.bounds_m, (2, 3))
    if shape.kind == "plane":  # a mesh, and below it a box
        return (low_m, high_m) if np.array_equal(turn, np.eye(3)) else None
    turn = turn @ matrix(shape.orientation)
    edges_m = _drawn_edges(body, BASE, orientation)
    if shape.kind != "box" or edges_m is None or not _right_angled(turn):
        return None
    margin_m = (high_m - low_m - abs(turn) @ edges_m) / 2
    return low_m + margin_m, high_m - margin_m


def _drawn_edges(body: Body, link: int, orientation: Sequence[float]) -> Float64 | None:
    """Return the edges of the shape that is drawn of a part if it is also what it collides with.

    It is if the box around it, turned like the part, is the recorded one.
    """
    shapes = [shape for shape in body.shapes if shape.link == link]
    own_m = _own_edges(shapes[0]) if len(shapes) == 1 else None
    if own_m is None:
        return None
    turn = abs(matrix(orientation) @ matrix(shapes[0].orientation))
    around_m = own_m if shapes[0].kind == "sphere" else turn @ own_m
    off_m = [np.abs(box_m(body, link) - margin_m - around_m).max() for margin_m in MARGINS_M]
    return own_m if min(off_m) <= ROUNDED * own_m.max() else None


def _own_edges(shape: Shape) -> Float64 | None:
    """Return the edges of the box around a shape that lies along its axes; None of a mesh."""
    size_m = shape.size_m
    if shape.kind == "box":
        return np.array(size_m[:3])
    if shape.kind == "sphere":
        return np.full(3, 2 * size_m[0])
    if shape.kind in ("cylinder", "capsule"):
        length_m, radius_m = size_m[:2]
        ends_m = 2 * radius_m if shape.kind == "capsule" else 0.0
        return np.array([2 * radius_m, 2 * radius_m, length_m + ends_m])
    return None


def _right_angled(turn: Float64) -> bool:
    """Whether a rotation only exchanges the axes."""
    return bool((abs(turn).max(axis=0) > 1 - ROUNDED**2).all())

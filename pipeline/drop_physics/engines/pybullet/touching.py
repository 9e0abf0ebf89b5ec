"""Finds the height at which a body touches the floor, from the distances that Bullet reports.

Bullet reports two distances. For separate bodies it rounds corners: a box that stands on a corner
seems 0.6 mm lower than it is. For touching bodies the distance is exact, and determines the contact
forces; the height follows from this one, which is known only while the bodies touch.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter

from drop_physics.engines.pybullet.engine import p
from drop_physics.option_types import Quaternion

Distance = Callable[[float], float | None]
"""Function from the height of the body's centre to its distance from the floor [m], or None."""

FAR_M = 1e3
"""A height from which no body touches the floor."""
FIRST_DEPTH_M = 1e-6
ROUNDING_M = 1e-14
"""Allowance for rounding [m]: the floor is a box of 10 m, so distances are rounded to 8.9e-16 m,
and a height is a sum of distances."""


def touching_height(
    apart: Distance, touching: Distance, *, start_m: float, size_m: float
) -> float | None:
    """Return the height of the centre at which the body touches the floor [m].

    Parameters
    ----------
    apart, touching
        Bullet's distance to the floor as a function of the height of the body's centre, for
        separate and for touching bodies [m].
    start_m
        A height at which the body is clear of the floor [m].
    size_m
        How far below the estimate from separate bodies to search for contact [m].

    Returns
    -------
    The height, or None if the body has no shape or never touches.
    """
    height_m = start_m
    for _ in range(2):  # the first time from far away, with the rounding of that
        distance_m = apart(height_m)
        if distance_m is None:
            return None
        height_m -= distance_m
    for _ in range(2):  # the first time perhaps too deep for an exact distance
        depth_m = FIRST_DEPTH_M
        while (distance_m := touching(height_m - depth_m)) is None:
            depth_m *= 2
            if depth_m > size_m:
                return None
        height_m -= depth_m + distance_m
    return height_m


def distances(
    body: int, floor: int | None, turned: Quaternion, client: int
) -> tuple[Distance, Distance]:
    """Return functions for Bullet's two distances to the floor: separated, and in contact.

    Parameters
    ----------
    body, floor, client
        PyBullet's numbers.
    turned
        The body's orientation, a quaternion x, y, z, w.
    """

    def place(height_m: float) -> None:
        p.resetBasePositionAndOrientation(body, (0.0, 0.0, height_m), turned, client)

    def apart(height_m: float) -> float | None:
        place(height_m)
        points = p.getClosestPoints(body, floor, FAR_M, physicsClientId=client)
        return min(map(_DISTANCE, points), default=None)

    def touching(height_m: float) -> float | None:
        # Far from the floor the engine forgets the contacts at the previous height.
        for height in (FAR_M, height_m):
            place(height)
            p.performCollisionDetection(physicsClientId=client)
        return min(map(_DISTANCE, p.getContactPoints(body, floor, -2, -2, client)), default=None)

    return apart, touching


_DISTANCE = itemgetter(8)
"""Function that returns the distance in a point of `getContactPoints`."""

"""Find the height at which a body touches the floor, by asking the engine how far apart they are.

The engine has two answers. The distance of bodies that are apart has round corners: a box that
stands on one seems to be 0.6 mm lower than it is. What contact acts on, and what is meant here, is
the distance of bodies that touch, which is exact but known only while they do.
"""

from __future__ import annotations

from collections.abc import Callable

Distance = Callable[[float], float | None]
"""From a height of the body's centre to its distance from the floor [m]; None where unknown."""

FIRST_DEPTH_M = 1e-6
ROUNDING_M = 1e-14
"""The floor is a box of 10 m, so that distances are rounded to 8.9e-16 m, and heights are sums."""


def touching_height(
    apart: Distance, touching: Distance, *, start_m: float, size_m: float
) -> float | None:
    """Return the height of the centre at which the body touches the floor [m].

    Parameters
    ----------
    apart, touching
        The two distances, of a body whose centre is at a height [m].
    start_m
        A height at which it is clear of the floor [m].
    size_m
        How far below the first answer to look for contact, at most [m].

    Returns
    -------
    The height, or None where the body has no shape or never touches.
    """
    height_m = start_m
    for _ in range(2):  # the first time from far away, and rounded as such
        distance_m = apart(height_m)
        if distance_m is None:
            return None
        height_m -= distance_m
    for _ in range(2):  # the first time perhaps deep, where a distance is no longer exact
        depth_m = FIRST_DEPTH_M
        while (distance_m := touching(height_m - depth_m)) is None:
            depth_m *= 2
            if depth_m > size_m:
                return None
        height_m -= depth_m + distance_m
    return height_m

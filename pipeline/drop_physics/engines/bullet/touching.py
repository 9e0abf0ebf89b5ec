"""Find the height at which a body touches the floor, by asking the engine how far apart they are.

The engine knows two distances. That of bodies apart has rounded corners: a box that stands on one
seems 0.6 mm lower than it is. Contact acts on the distance of touching bodies, which is meant here:
it is exact, but known only while they touch.
"""

from __future__ import annotations

from collections.abc import Callable

Distance = Callable[[float], float | None]
"""From a height of the body's centre to its distance from the floor [m]; None if unknown."""

FIRST_DEPTH_M = 1e-6
ROUNDING_M = 1e-14
"""The floor is a box of 10 m, so distances are rounded to 8.9e-16 m; heights are sums of them."""


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

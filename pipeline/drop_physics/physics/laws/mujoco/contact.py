"""The depth at which a body rests in the floor in MuJoCo, whose contacts act as springs.

A contact point of depth p supports the body with the acceleration d k p / (1 - d), where the
impedance d grows with p, and k follows from `solref` (documentation, "Solver parameters"). At rest,
n points together balance g:

    p = g (1 - d) / (d k n)      d = d0 + (dw - d0) y(p / width)      k = d / (dw² τ² ζ²)

Mass and size cancel. Source of d: `engine_core_constraint.c`, `getimpedance`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence


def rest_depth_m(
    gravity_m_s2: float, points: int, solref: Sequence[float], solimp: Sequence[float]
) -> float | None:
    """Return the depth [m] at which this many contact points carry a body.

    None if `solref` consists of two negative numbers, which mean stiffness and damping.
    """
    from scipy.optimize import brentq  # slow to import, and needed here only

    time_constant_s, ratio = solref
    d0, dw, width_m, _, _ = solimp
    if time_constant_s <= 0 or ratio <= 0 or width_m <= 0:
        return None

    def off(depth_m: float) -> float:
        d = impedance(depth_m, solimp)
        stiffness = d / (dw * time_constant_s * ratio) ** 2
        return depth_m - gravity_m_s2 * (1 - d) / (d * stiffness * points)

    deepest_m = gravity_m_s2 * (1 - d0) / (d0 * d0) * (dw * time_constant_s * ratio) ** 2 / points
    depth_m: float = brentq(off, 0.0, deepest_m, xtol=1e-16, rtol=1e-14)
    return depth_m


def shortest_s(timestep_s: float) -> float:
    """Return the shortest time constant that MuJoCo uses [s] (documentation, "refsafe")."""
    return 2 * timestep_s


def impedance(depth_m: float, solimp: Sequence[float]) -> float:
    """Return the impedance d at a depth [m], a power law from d0 to dw within the width."""
    d0, dw, width_m, middle, power = solimp
    x = min(depth_m / width_m, 1.0)
    if x < middle:
        y = math.pow(x, power) / math.pow(middle, power - 1)
    else:
        y = 1 - math.pow(1 - x, power) / math.pow(1 - middle, power - 1)
    return d0 + (dw - d0) * y

"""Extrapolates results to a timestep of zero, by Richardson's method.

Timesteps are always ordered coarse to fine. Richardson's extrapolation needs no exact solution,
only a sequence that converges.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

SAFETY_FACTOR = 1.25
"""Roache's safety factor for three or more grids, with an observed order near the formal one."""
LEAST_ORDER, MOST_ORDER = 1e-6, 64.0
"""Range of plausible orders: outside it, solutions do not converge."""


def solution_order(timesteps_s: Sequence[float], solutions: Sequence[float]) -> float | None:
    """Return the order p at which three solutions, coarse to fine, converge.

    For f = f0 + c h^p it is the root of (f3 - f2)/(f2 - f1) = r21^p (r32^p - 1)/(r21^p - 1), whose
    right side grows with p; with one ratio r it is ln[(f3 - f2)/(f2 - f1)] / ln r. None if the
    solutions do not approach a limit from one side.

    Source: I. B. Celik et al., "Procedure for estimation and reporting of uncertainty due to
    discretization in CFD applications", *J. Fluids Eng.* 130, 078001 (2008), step 3, whose
    fixed-point iteration need not converge where the ratios differ.
    """
    (h3, h2, h1), (f3, f2, f1) = timesteps_s, solutions
    if f2 == f1 or (f3 - f2) / (f2 - f1) <= 0:
        return None
    coarse, fine, quotient = math.log(h3 / h2), math.log(h2 / h1), (f3 - f2) / (f2 - f1)
    low, high = 0.0, MOST_ORDER
    while max(low, LEAST_ORDER) < (order := (low + high) / 2) < high:
        grown = -math.expm1(order * coarse) / math.expm1(-order * fine)
        low, high = (order, high) if grown < quotient else (low, order)
    return order if LEAST_ORDER < order < MOST_ORDER - LEAST_ORDER else None


def richardson(coarse: float, fine: float, *, ratio: float, order: float) -> float:
    """Return the limit of two results that converge with order p: f1 + (f1 - f2)/(r^p - 1).

    Source: L. F. Richardson, *Phil. Trans. R. Soc. A* 210, 307 (1911); Oberkampf and Roy, 8.3.
    """
    return fine + (fine - coarse) / (math.pow(ratio, order) - 1)

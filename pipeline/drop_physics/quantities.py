"""Numbers with their units as readers see them: three digits, small lengths in millimetres."""

from __future__ import annotations

import math

SMALL_M = 0.1
"""Lengths [m] and speeds [m/s] below this are written in millimetres."""
LARGE, HUGE = 1e3, 1e7
"""Numbers from LARGE on have no decimals, from HUGE on powers of ten."""


def quantity(value: float, unit: str = "", sign: str = "") -> str:
    """Return a number in three digits with its unit; `sign` is that of Python's formats."""
    if unit in ("m", "m/s") and 0 < abs(value) < SMALL_M:
        value, unit = value * 1e3, f"m{unit}"
    return f"{number(value, sign)} {unit}".rstrip()


def number(value: float, sign: str = "") -> str:
    """Return a number in three digits; `sign` is that of Python's formats."""
    if not math.isfinite(value):
        return f"{value:{sign}}"
    if LARGE <= abs(value) < HUGE:
        return f"{value:{sign},.0f}"
    return f"{value + 0.0:{sign}.3g}"

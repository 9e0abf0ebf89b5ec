"""Format numbers with units for readers: three digits, small lengths in millimetres."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

SMALL_M = 0.1
"""Length [m] or speed [m/s] below which millimetres are used."""
LARGE, HUGE = 1e3, 1e7
"""Numbers have no decimals from LARGE on, and are written in powers of ten from HUGE on."""


ROUNDED = 1e-12
"""Share of the largest number of a sum below which another one is rounding error."""
DIGITS = 3
"""Default number of significant digits."""


def quantity(value: float, unit: str = "", sign: str = "", digits: int = DIGITS) -> str:
    """Format a number with its unit; `sign` as in Python's format strings."""
    if unit in ("m", "m/s") and 0 < abs(value) < SMALL_M:
        value, unit = value * 1e3, f"m{unit}"
    return f"{number(value, sign, digits)} {unit}".rstrip()


def number(value: float, sign: str = "", digits: int = DIGITS) -> str:
    """Format a number; `sign` as in Python's format strings."""
    if not math.isfinite(value):
        return f"{value:{sign}}"
    if LARGE <= abs(value) < HUGE:
        return f"{value:{sign},.{max(0, digits - len(str(int(abs(value)))))}f}"
    return f"{value + 0.0:{sign}.{digits}g}"


def rounded_off(value: float, largest: float) -> float:
    """Return a number of a sum, or 0 if it is rounding error beside the sum's largest number."""
    return value if abs(value) > ROUNDED * abs(largest) else 0.0


# -- as findings write them ----------------------------------------------------------------------


def gap(value: float, unit: str) -> str:
    """Format the size of a distance or an angle in two digits; below 1 m in millimetres."""
    if unit == "m" and abs(value) < 1:
        return f"{abs(value) * 1e3:.3g} mm"
    return f"{abs(value):.3g} {unit}" if abs(value) >= 10 else f"{abs(value):.2g} {unit}"


def place(value: float, unit: str) -> str:
    """Format a position, to the millimetre or to a hundredth of a radian."""
    return f"{value:.3f} m" if unit == "m" else f"{value:.2f} {unit}"


def effort(value: float, unit: str) -> str:
    """Format the size of a force or torque: two digits below 10, integers above."""
    return f"{abs(value):.0f} {unit}" if 10 <= abs(value) < 1e6 else f"{abs(value):.2g} {unit}"


KINDS: Mapping[str, Callable[[float, str, str], str]] = {
    "gap": lambda value, unit, _: gap(value, unit),
    "at": lambda value, unit, _: place(value, unit),
    "N": lambda value, _, force: effort(value, force),
    "N s": lambda value, _, force: effort(value, f"{force} s"),
    "N s/rad": lambda value, unit, force: effort(value, f"{force} s/{unit}"),
    "mm": lambda value, _, __: f"{value * 1e3:.3g} mm",
    "speed": lambda value, unit, _: f"{abs(value):.2g} {unit}/s",
}
"""Formatter of each kind of number, with the units of positions and forces."""


class Written(str):
    """A number that is already text, and ignores the format that a template requests."""

    __slots__ = ()

    def __format__(self, form: str) -> str:
        return str(self)

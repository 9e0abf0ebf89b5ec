"""Reads the numbers in a recorded call by argument name."""

from __future__ import annotations

from typing import overload

from drop_physics.trace.calls import Call
from drop_physics.trace.events import Site, located
from drop_physics.trace.readings import Reading


def given(call: Call, name: str) -> tuple[float, ...]:
    """Return the numeric values of an argument; empty if the call does not have it."""
    place = call.site.places.get(name)
    return () if place is None else call.numbers[place]


@overload
def number(call: Call, name: str) -> float | None: ...
@overload
def number(call: Call, name: str, default: float) -> float: ...
def number(call: Call, name: str, default: float | None = None) -> float | None:
    """Return the value of an argument that is a single number, or a default if it is missing."""
    numbers = given(call, name)
    return numbers[0] if numbers else default


def site_of(where: Call | Reading | Site) -> str:
    """Format file and line of a call, as findings cite it."""
    return located(where.file, where.line)

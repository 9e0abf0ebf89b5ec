"""Which body a call names, which of its numbers are which argument, and where it stands."""

from __future__ import annotations

import math
from collections.abc import Iterator
from heapq import merge

from drop_physics.analysis.called import called
from drop_physics.seen.calls import Call
from drop_physics.seen.events import Appearance, Body, Site
from drop_physics.seen.history import Piece


def calls_of(
    piece: Piece, appearances: list[Appearance], *functions: str
) -> Iterator[tuple[Call, Body]]:
    """Yield the calls of functions by the beginning of their names, each with its body."""
    found = [its for name, its in called(piece, appearances).items() if name.startswith(functions)]
    together = found[0] if len(found) == 1 else merge(*found, key=lambda pair: pair[0].at.call)
    for call, came in together:
        yield call, came.body


def given(call: Call, name: str) -> tuple[float, ...]:
    """Return the numbers of an argument; none if it was not given."""
    place = call.site.places.get(name)
    return () if place is None else call.numbers[place]


def number(call: Call, name: str, default: float = math.nan) -> float:
    """Return the number of an argument that is one."""
    numbers = given(call, name)
    return numbers[0] if numbers else default


def site_of(where: Call | Site) -> str:
    """Return file and line of a call, as findings cite it."""
    return f"{where.file}:{where.line}"

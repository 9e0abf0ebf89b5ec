"""Which body a call names, and which of its numbers are which argument."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

from drop_physics.seen.calls import BODY_NAMES, Call, Meanings
from drop_physics.seen.events import Appearance, Body, Site
from drop_physics.seen.history import Piece

LIVES = ("load", "createMultiBody", "removeBody", "resetSimulation")
"""Beginnings of the functions that make bodies and remove them."""


def calls_of(
    piece: Piece, appearances: list[Appearance], *functions: str
) -> Iterator[tuple[Call, Body]]:
    """Yield the calls of functions by the beginning of their names, each with its body."""
    kept = [each for each in piece.calls if each.site.function.startswith((*functions, *LIVES))]
    meanings = Meanings(kept, appearances)
    for call in kept:
        if call.raised or not call.function.startswith(functions):
            continue
        numbers = next((n for name in BODY_NAMES if (n := given(call, name))), ())
        came = meanings.body_at(call, int(numbers[0])) if numbers else None
        if came is not None:
            yield call, came.body


def given(call: Call, name: str) -> tuple[float, ...]:
    """Return the numbers of an argument; none if it was not given."""
    place = _places(call.site).get(name)
    return () if place is None else call.numbers[place]


def number(call: Call, name: str, default: float = math.nan) -> float:
    """Return the number of an argument that is one."""
    numbers = given(call, name)
    return numbers[0] if numbers else default


@lru_cache(maxsize=4096)
def _places(site: Site) -> dict[str, slice]:
    places: dict[str, slice] = {}
    for k, name in enumerate(site.names):
        first = places[name].start if name in places else k
        places[name] = slice(first, k + 1)
    return places

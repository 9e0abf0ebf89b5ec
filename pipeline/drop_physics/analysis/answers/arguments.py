"""Which body a call names, and which of its numbers are which argument."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

from drop_physics.seen.calls import BODY_NAMES, Call, Meanings
from drop_physics.seen.events import Appearance, Body
from drop_physics.seen.history import Piece

LIVES = ("load", "createMultiBody", "removeBody", "resetSimulation")
"""Beginnings of the functions that make bodies and remove them."""


def calls_of(
    piece: Piece, appearances: list[Appearance], *functions: str
) -> Iterator[tuple[Call, Body]]:
    """Yield the calls of functions by the beginning of their names, each with its body."""
    kept = [each for each in piece.calls if each.site.function.startswith((*functions, *LIVES))]
    meanings = Meanings(kept, appearances)
    sole = _sole(kept, appearances)
    for call in kept:
        if call.raised or not call.site.function.startswith(functions):
            continue
        numbers = next((n for name in BODY_NAMES if (n := given(call, name))), ())
        if numbers:
            body = sole.get((call.client, int(numbers[0])))
            if body is None:
                came = meanings.body_at(call, int(numbers[0]))
                body = None if came is None else came.body
            if body is not None:
                yield call, body


def _sole(calls: list[Call], appearances: list[Appearance]) -> dict[tuple[int, int], Body]:
    """Return the bodies whose ids no other has, while none is removed."""
    if any(each.site.function in LIVES[2:] for each in calls):
        return {}
    bodies: dict[tuple[int, int], list[Body]] = {}
    for each in appearances:
        if each.came:
            bodies.setdefault((each.body.client, each.body.engine_id), []).append(each.body)
    return {key: found[0] for key, found in bodies.items() if len(found) == 1}


def given(call: Call, name: str) -> tuple[float, ...]:
    """Return the numbers of an argument; none if it was not given."""
    place = _places(call.site.names).get(name)
    return () if place is None else call.numbers[place]


def number(call: Call, name: str, default: float = math.nan) -> float:
    """Return the number of an argument that is one."""
    numbers = given(call, name)
    return numbers[0] if numbers else default


@lru_cache(maxsize=4096)
def _places(names: tuple[str, ...]) -> dict[str, slice]:
    places: dict[str, slice] = {}
    for k, name in enumerate(names):
        first = places[name].start if name in places else k
        places[name] = slice(first, k + 1)
    return places

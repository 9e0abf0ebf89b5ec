"""Which body each call of a piece names: found once, for all who ask."""

from __future__ import annotations

from collections.abc import Mapping
from weakref import WeakKeyDictionary

from drop_physics.seen.calls import BODY_NAMES, Call, Meanings
from drop_physics.seen.events import Appearance
from drop_physics.seen.history import Piece

LIVES = ("load", "createMultiBody", "removeBody", "resetSimulation")
"""Beginnings of the functions that make bodies and remove them."""

Called = Mapping[str, list[tuple[Call, Appearance]]]
"""By function, its calls that name a body and did not fail, in order."""

_FOUND: WeakKeyDictionary[Piece, Called] = WeakKeyDictionary()


def called(piece: Piece, appearances: list[Appearance]) -> Called:
    """Return the calls of a piece that name a body."""
    found = _FOUND.get(piece)
    if found is None:
        found = _FOUND[piece] = _called(piece, appearances)
    return found


def _called(piece: Piece, appearances: list[Appearance]) -> Called:
    by_site: dict[int, list[Call]] = {}
    for call in piece.calls:
        if not call.raised:
            by_site.setdefault(call.site.number, []).append(call)
    lives = [call for calls in by_site.values() for call in calls
        if calls[0].function.startswith(LIVES)]  # fmt: skip
    meanings = Meanings(sorted(lives, key=lambda call: call.at.call), appearances)
    sole = _sole(lives, appearances)
    found: dict[str, list[tuple[Call, Appearance]]] = {}
    for calls in by_site.values():
        site = calls[0].site
        place = next((at for name in BODY_NAMES if (at := site.places.get(name))), None)
        if place is None:
            continue
        its = found.setdefault(site.function, [])
        for call in calls:
            number = int(call.numbers[place.start])
            came = sole.get((call.client, number)) or meanings.body_at(call, number)
            if came is not None:
                its.append((call, came))
    for its in found.values():
        its.sort(key=lambda pair: pair[0].at.call)
    return found


def _sole(lives: list[Call], appearances: list[Appearance]) -> dict[tuple[int, int], Appearance]:
    """Return the bodies whose ids no other has, while none is removed."""
    if any(each.function in LIVES[2:] for each in lives):
        return {}
    came: dict[tuple[int, int], list[Appearance]] = {}
    for each in appearances:
        if each.came:
            came.setdefault((each.body.client, each.body.engine_id), []).append(each)
    return {key: found[0] for key, found in came.items() if len(found) == 1}

"""Pairs of shapes that could collide, but whose contacts the model excludes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from drop_physics.explain.solids import Solid, solid_of
from drop_physics.physics.tree import BASE
from drop_physics.trace.events import Body, Collision
from drop_physics.trace.history import Seen
from drop_physics.trace.switches import NO_CONTACT, is_off

MOST_PAIRS = 200
"""Largest number of shape pairs that are examined: in a larger world, filters are intentional."""


@dataclass(frozen=True)
class FilteredPair:
    """Two shapes between which the model excludes contacts."""

    bodies: tuple[int, int]
    solids: tuple[Solid, Solid]
    is_excluded: bool = False
    """Whether the model excludes the pair by name."""
    is_family: bool = False
    """Whether one is the parent of the other; otherwise their bits have nothing in common."""
    is_off: bool = False
    """Whether the model disables all contacts."""


class FilteredPairs:
    """The excluded pairs of a recording, and which of them overlap from the beginning."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen
        self.at_first: set[int] = set()
        """Indices of the pairs that overlap from the beginning."""

    @cached_property
    def pairs(self) -> list[FilteredPair]:
        """The examined pairs; none if there are too many."""
        pairs = [*_filtered(self._seen)]
        return pairs if len(pairs) <= MOST_PAIRS else []


def _filtered(seen: Seen) -> Iterator[FilteredPair]:
    """Yield the pairs of shapes that could collide, but whose contacts the model excludes."""
    shapes = [
        (body, collision, solid)
        for body in seen.bodies.values()
        for collision in (*body.collisions, *_only_seen(body))
        if collision.bits is not None and (solid := solid_of(collision)) is not None
    ]
    apart = {
        frozenset(((body.number, own), (other, its)))
        for body in seen.bodies.values()
        for own, other, its in body.apart
    }
    clients = {body.client for body in seen.bodies.values()}
    off = {client for client in clients if is_off(seen, client, NO_CONTACT)}
    for place, (body_a, a, solid_a) in enumerate(shapes):
        for body_b, b, solid_b in shapes[place + 1 :]:
            if body_a.client != body_b.client or not (body_a.moving or body_b.moving):
                continue
            assert a.bits is not None
            assert b.bits is not None
            # What is only seen is a marker or a design, unless it is to take what lies free.
            is_seen = not (any(a.bits) and any(b.bits))
            if is_seen and body_a.base_moves == body_b.base_moves:
                continue
            bodies, solids = (body_a.number, body_b.number), (solid_a, solid_b)
            meets = bool(a.bits[0] & b.bits[1] or b.bits[0] & a.bits[1])
            excluded = frozenset(((body_a.number, a.link), (body_b.number, b.link))) in apart
            if body_a is not body_b and body_a.client in off:
                yield FilteredPair(bodies, solids, is_off=True)
            elif body_a is not body_b and (excluded or not meets):
                yield FilteredPair(bodies, solids, is_excluded=excluded)
            elif body_a.client in off:
                continue
            elif body_a is body_b and meets and not excluded and _is_child(body_a, a.link, b.link):
                yield FilteredPair(bodies, solids, is_family=True)


def _only_seen(body: Body) -> Iterator[Collision]:
    """Yield the visible shapes of bodies with joints, and floors, if none of them can collide."""
    holds = {collision.kind for collision in body.collisions}
    for each in () if body.base_moves else body.shapes:
        if not holds if body.joints else each.kind == "plane" and "plane" not in holds:
            place = each.position_m, each.orientation
            yield Collision(each.link, each.kind, each.size_m, "", *place, bits=(0, 0))


def _is_child(body: Body, one: int, other: int) -> bool:
    """Return whether one of two links is the movable child of the other, and rotates on it.

    A link that slides on its parent may be made to slide into it, as a telescope's tubes are.
    """
    link, parent = max(one, other), min(one, other)
    if link == parent or parent not in body.moving or body.joints[link].kind == "prismatic":
        return False
    above = body.joints[link].parent
    # A link whose name has a slash is between two joints of one body of the model.
    while above != BASE and above != parent and "/" in body.links[above + 1]:
        above = body.joints[above].parent
    return above == parent

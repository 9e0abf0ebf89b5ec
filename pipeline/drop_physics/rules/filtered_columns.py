"""The table of shapes with excluded contacts, in the steps in which they overlap."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.solids import Solid, overlap_m, solid_of
from drop_physics.physics.columns import rotation
from drop_physics.physics.kinematics import Kinematics, kinematics
from drop_physics.physics.tree import BASE
from drop_physics.rules.answer import Scene
from drop_physics.trace.events import Body, Collision
from drop_physics.trace.switches import NO_CONTACT, is_off

MOST_PAIRS = 200
"""Largest number of pairs of shapes that are examined: in a world of more, filters are intended."""
EVERY = 2000
"""Number of steps of a piece that are examined."""


@dataclass(frozen=True)
class FilteredPair:
    """Two shapes whose contacts the model excludes."""

    bodies: tuple[int, int]
    solids: tuple[Solid, Solid]
    is_excluded: bool = False
    """Whether the model excludes them by name."""
    is_family: bool = False
    """Whether one is the parent of the other; else their bits have nothing in common."""
    is_off: bool = False
    """Whether the model switches all contacts off."""


@dataclass(frozen=True, eq=False)
class FilteredColumns:
    """Rows of pairs and steps in which they overlap, all of shape (n,)."""

    keys: Int64
    """Both bodies, and the place of the pair in `filtered_pairs`, shape (n, 3)."""
    step: Int64
    depth_m: Float64
    noted: Mapping[str, Float64]


def filtered_pairs(scene: Scene) -> list[FilteredPair]:
    """Return the examined pairs; none if there are too many."""
    if FilteredPair not in scene.kept:
        pairs = [*_filtered(scene)]
        scene.kept[FilteredPair] = pairs if len(pairs) <= MOST_PAIRS else []
    return list(scene.kept[FilteredPair])


def filtered_columns(scene: Scene) -> Iterator[FilteredColumns]:
    """Yield the table of the latest piece, without pairs that overlap from the beginning on."""
    poses: dict[int, tuple[Int64, Kinematics]] = {}
    at_first: set[int] = scene.kept.setdefault("overlap at first", set())
    pairs = filtered_pairs(scene)
    for number, judged in scene.judged.items() if pairs else ():
        intervals = [each for each in judged.intervals if len(each)]
        if len(intervals) == 1:  # else its model is edited on the way
            (its,) = intervals
            rows = np.arange(0, len(its), max(1, -(-len(its) // EVERY)))
            poses[number] = its.steps[rows] - 1, kinematics(its.law.tree, its.before.at(rows))
    for place, pair in enumerate(pairs):
        lead = next((each for each in pair.bodies if each in poses), None)
        if place in at_first or lead is None:
            continue
        steps = poses[lead][0]
        where = [
            _where(scene, number, solid.collision.link, steps, poses.get(number))
            for number, solid in zip(pair.bodies, pair.solids, strict=True)
        ]
        if where[0] is None or where[1] is None:
            continue
        depth = overlap_m(pair.solids[0], where[0], pair.solids[1], where[1])
        if steps[0] == 0 and depth[0] > 0:
            at_first.add(place)
            continue
        rows = np.flatnonzero(depth)
        keys = np.tile((*pair.bodies, place), (len(rows), 1))
        yield FilteredColumns(keys, steps[rows] + 1, depth[rows], {})


def _where(
    scene: Scene, number: int, link: int, steps: Int64, pose: tuple[Int64, Kinematics] | None
) -> tuple[Float64, Float64] | None:
    """Return positions and rotations of a link before steps; None if they are not known."""
    if pose is not None:
        same = np.array_equal(pose[0], steps)
        return (pose[1].position_m(link), pose[1].matrix(link)) if same else None
    if link != BASE or number not in scene.records:
        return None
    base = scene.records[number].base_at(steps)
    return base[:, :3], np.moveaxis(rotation(base[:, 3:7].T), -1, 0)


def _filtered(scene: Scene) -> Iterator[FilteredPair]:
    """Yield the pairs of shapes that could meet and whose contacts the model excludes."""
    shapes = [
        (body, collision, solid)
        for body in scene.seen.bodies.values()
        for collision in (*body.collisions, *_only_seen(body))
        if collision.bits is not None and (solid := solid_of(collision)) is not None
    ]
    apart = {
        frozenset(((body.number, own), (other, its)))
        for body in scene.seen.bodies.values()
        for own, other, its in body.apart
    }
    clients = {body.client for body in scene.seen.bodies.values()}
    off = {each for each in clients if is_off(scene.seen, each, NO_CONTACT)}
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
    """Yield the shapes of bodies with joints, and floors, of which no shape can be touched."""
    holds = {each.kind for each in body.collisions}
    for each in () if body.base_moves else body.shapes:
        if not holds if body.joints else each.kind == "plane" and "plane" not in holds:
            place = each.position_m, each.orientation
            yield Collision(each.link, each.kind, each.size_m, "", *place, bits=(0, 0))


def _is_child(body: Body, one: int, other: int) -> bool:
    """Return whether one of two links is the movable child of the other, and turns on it.

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

"""The table of overlapping links between which the engine makes no contacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations, product

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.overlap import PlacedShape, is_convex, overlaps
from drop_physics.physics.rotations import products, quaternions, rotate
from drop_physics.physics.tree import BASE
from drop_physics.rules.answer import Scene
from drop_physics.rules.arguments import number
from drop_physics.rules.inputs import Place
from drop_physics.rules.thresholds import DEEP_M
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body, Collision

Pair = tuple[Place, Place]
Shapes = dict[Place, list[Collision]]
"""Convex shapes, by link."""

LOOKS = 200
"""Number of evenly spaced steps of a chunk that are checked for overlaps."""
SELF_COLLISION, OF_PARENTS = 8, 16 | 32 | 8192
"""`flags` of `loadURDF`: `URDF_USE_SELF_COLLISION`, and those that say whether a link collides with
its parent: …`_EXCLUDE_PARENT`, …`_EXCLUDE_ALL_PARENTS`, …`_INCLUDE_PARENT`."""
USUAL = {True: (1, -1), False: (2, -3)}
"""Default collision group and mask: for movable bodies, and for others."""
POINT = Collision(BASE, "sphere", (DEEP_M,), "", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
"""Shape that is used for a link without one."""


@dataclass(frozen=True, eq=False)
class UnpairedColumns:
    """Two links in the n samples in which they overlap; shape (n,)."""

    keys: Int64
    """Ids of both bodies and both links, shape (n, 4)."""
    step: Int64
    reason: str
    call: Call | None
    """The call that disabled the pair's contacts."""
    noted: Mapping[str, Float64] = field(default_factory=dict)


def unpaired_columns(scene: Scene) -> Iterator[UnpairedColumns]:
    """Yield the pairs of the latest chunk that overlap without a contact between them."""
    shapes: Shapes = {}
    for one, body in scene.seen.bodies.items():
        for shape in filter(is_convex, body.collisions):
            shapes.setdefault((one, shape.link), []).append(shape)
    pairs: dict[frozenset[Place], tuple[Pair, str, Call | None]] = {}
    for each in _unpaired(scene, shapes):
        pairs.setdefault(frozenset(each[0]), each)
    for pair, reason, call in pairs.values():
        bodies = [scene.body(place[0]) for place in pair]
        # Such a pair is `tunnelled`'s: a single body and a box that stays.
        by_pair = call is not None and call.act is not Act.FILTER_GROUP
        boxes = any(
            one.base_moves
            and not one.joints
            and not other.moving
            and [shape.kind for shape in other.collisions] == ["box"]
            for one, other in (bodies, bodies[::-1])
        )
        left = boxes and (by_pair or call is None)
        if frozenset(each.number for each in bodies) not in scene.inputs.joined and not left:
            yield from _overlapping(scene, shapes, pair, reason, call)


def _unpaired(scene: Scene, shapes: Shapes) -> Iterator[tuple[Pair, str, Call | None]]:
    """Yield pairs of links between which the engine makes no contact, with the reason."""
    bodies, inputs = scene.seen.bodies, scene.inputs
    for both, call in inputs.passes.items():
        if len(both) == 2:
            one, two = sorted(both)
            yield (one, two), "filter", call
    for one, call in inputs.groups.items():
        # Of two that are both given groups it is intended that these exclude each other.
        for two in shapes.keys() - inputs.groups.keys() if one in shapes else ():
            group, mask = (
                (int(number(call, f"collisionFilter{name}")), usual)
                for name, usual in zip(
                    ("Group", "Mask"), USUAL[two[1] in bodies[two[0]].moving], strict=True
                )
            )
            if one[0] != two[0] and not (group[0] & mask[1] or group[1] & mask[0]):
                yield (one, two), "filter", call
    posed = {use.body.number for use in inputs.of(Act.SET_POSE) if use.body}
    asked = {
        frozenset((subject.body, subject.other))
        for reading in scene.seen.readings
        if reading.act is Act.READ_CONTACTS
        for subject in reading.targets
    }
    still = [place for place in shapes if not bodies[place[0]].moving]
    for one, two in combinations(still, 2):
        about = {frozenset((one[0], each)) for each in (two[0], None)}
        if {one[0], two[0]} & posed and (about | {frozenset((two[0], None))}) & asked:
            yield ((one, two) if one[0] in posed else (two, one)), "both-static", None
    for of, body in bodies.items():
        places = [place for place in shapes if place[0] == of and place[1] >= 0]
        if not body.base_moves:
            for place in places:
                if _counts_static(body, place[1]):
                    for other in still:
                        yield (place, other), "link-counted-static", None
        if body.flags & SELF_COLLISION and not body.flags & OF_PARENTS:
            for place in places:
                parent = of, body.joints[place[1]].parent
                # What slides on its parent may be made to slide into it, as a telescope's tubes.
                if parent in shapes and body.joints[place[1]].kind != "prismatic":
                    yield (place, parent), "parent-and-child", None
        if body.base_moves and not body.joints and not body.collisions and not body.soft:
            for other in shapes:
                yield ((of, BASE), other), "no-shape", None


def _counts_static(body: Body, link: int) -> bool:
    """Return whether a link is fixed, directly or through others, to link 0 of a massless base."""
    if link == 0 or link not in body.moving:
        return False
    while link > 0:
        if body.joints[link].widths[1]:
            return False
        link = body.joints[link].parent
    return link == 0 and bool(body.joints[0].widths[1])


def _overlapping(
    scene: Scene, shapes: Shapes, pair: Pair, reason: str, call: Call | None
) -> Iterator[UnpairedColumns]:
    """Yield the samples in which two initially separate links overlap without any push."""
    bodies = [scene.body(place[0]) for place in pair]
    if bodies[0].client != bodies[1].client:
        return
    moving = [body.number for body in bodies if body.number in scene.judged]
    piece, last = scene.piece, scene.seen.samples.get(bodies[0].client, 0)
    samples = np.arange(max(piece.first, 1), min(piece.end, last))
    for body in moving:
        mine = [steps.steps for _, steps in scene.intervals(body)]
        samples = np.intersect1d(samples, np.concatenate(mine)) if mine else samples[:0]
    if call is not None:
        samples = samples[samples > call.at.step]
    every = max(1, -(-len(samples) // LOOKS))
    samples = samples[::every]
    placed = [_placed(scene, shapes, place, samples) for place in pair]
    if not len(samples) or not all(placed):
        return
    deep = np.zeros(len(samples), np.bool_)
    for one, two in product(*placed):
        deep |= overlaps(one, two, DEEP_M)
    deep &= ~np.isin(samples, _pressed(scene, pair))
    if not deep[0] or not moving:
        scene.apart.add(pair)
    if deep.any() and pair in scene.apart:
        steps = (samples[deep][:, None] + np.arange(every)).ravel()  # those between two looks
        keys = np.tile(
            [each.number for each in bodies] + [link for _, link in pair], (len(steps), 1)
        )
        yield UnpairedColumns(keys, steps, reason, call)


def _pressed(scene: Scene, pair: Pair) -> Int64:
    """Return the samples after steps in which a contact between two links pushed."""
    points = scene.pairs.points
    places = np.stack([points.body, points.link], axis=2)
    its = [(places == both).all(axis=(1, 2)) for both in (pair, pair[::-1])]
    return np.asarray(points.step[(its[0] | its[1]) & (points.normal_n > 0)])


def _placed(scene: Scene, shapes: Shapes, place: Place, samples: Int64) -> list[PlacedShape]:
    """Return a link's shapes placed at samples; a point if it has none."""
    centre_m, axes = scene.placed(*place, samples)
    if np.isnan(centre_m).any():
        return []
    turned = quaternions(np.moveaxis(axes, 0, -1))
    return [
        PlacedShape(
            shape,
            centre_m + rotate(turned, np.tile(shape.position_m, (len(samples), 1))),
            products(turned, np.tile(shape.orientation, (len(samples), 1))),
        )
        for shape in shapes.get(place, [POINT])
    ]

"""Rows for shapes that overlap although no contact between them is possible."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.touches import PairKey, TouchedLinks
from drop_physics.account.words import RowWords
from drop_physics.arrays import Float64, Int64
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.solids import Solid, overlap_m, solid_of
from drop_physics.messages import Message
from drop_physics.physics.tree import BASE
from drop_physics.quantities import quantity
from drop_physics.trace.acts import FILTERS, Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body, Collision
from drop_physics.trace.history import Seen
from drop_physics.trace.log import PAIR, Log
from drop_physics.trace.switches import NO_CONTACT, is_off

LOOKS, POSES = (16, 200), 6400
"""Minimum and maximum number of evenly spaced samples of a chunk that are checked, and the number
of samples of all pairs together."""
MOST_SHAPES, MOST_PAIRS = 200, 400
"""Maximum numbers of shapes and of pairs that are checked: in a larger world, disabled contacts are
taken as intended."""
MOST_CORNERS = 1000
"""Maximum number of corners of a hull that is checked, because larger hulls take too long."""
LEAST_M, DEEP = 1e-3, 0.05
"""Minimum overlap; and the share of the smaller shape's size above which an overlap stands out."""
DESIGNED = ("one-robot", "parent-and-child")
"""Causes for which a small overlap is how a robot is made."""
SELF_COLLISION, OF_PARENTS = 8, 16 | 32 | 8192
"""`flags` of `loadURDF`: `URDF_USE_SELF_COLLISION`, and those that control contacts between parent
and child."""
USUAL = {True: (1, -1), False: (2, -3)}
"""Default collision group and mask: for movable bodies, and for others."""
POINT = Collision(BASE, "sphere", (LEAST_M,), "", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
"""The shape of a body without one."""
WHY = {
    "flag": Message("a flag of the model switches contacts off"),
    "exclude": Message("the model excludes their contact"),
    "bits": Message("their collision groups and masks share no bit"),
    "parent-and-child": Message("one is the parent of the other"),
    "one-robot": Message("links of one body, which was loaded without self-collision"),
    "no-shape": Message("one of them has no shape that anything can touch"),
    "both-static": Message("neither has mass"),
    "link-counted-static": Message("a link that is fixed to the first of a fixed base is static"),
    "filter": Message("{line} filters their contacts"),
    "groups": Message("{line} filters their contacts, and so does another call for the other one"),
}
"""Causes for which two shapes make no contact."""

Place = tuple[int, int]
"""A body id, and a link of the body."""


@dataclass(frozen=True, eq=False)
class HeldShape:
    """A collision shape (or visual one) of a body, with its link."""

    body: Body
    solid: Solid
    is_seen: bool
    """Whether the shape is only seen, and cannot collide."""
    moves: bool
    """Whether steps or calls change the shape's pose."""

    @property
    def place(self) -> Place:
        """The body's id, and the shape's link."""
        return self.body.number, self.solid.collision.link


@dataclass(eq=False)
class Overlap:
    """Two overlapping shapes between which no contact is possible; filled chunk by chunk."""

    shapes: tuple[HeldShape, HeldShape]
    cause: str
    """A key of `WHY`."""
    call: Call | None = None
    """The call that disabled their contacts."""
    until: float = np.inf
    """The step after which another call enabled their contacts."""
    at_first: bool | None = None
    """Whether the shapes overlap at the first check."""
    deepest_m: float = 0.0
    step: int = -1
    count: int = 0
    """Number of steps in which the shapes overlap, as far as the checked samples tell."""
    span: tuple[int, int] = (0, 0)
    """The first and the last checked sample in which the shapes overlap."""

    @property
    def since(self) -> int:
        """The last step before contacts became impossible."""
        return -1 if self.call is None else self.call.at.step

    @property
    def places(self) -> frozenset[Place]:
        """Bodies and links of both shapes."""
        return frozenset(shape.place for shape in self.shapes)

    def add(self, samples: Int64, depth_m: Float64, every: int) -> None:
        """Add the overlap depth at samples, each standing for `every` steps."""
        if self.at_first is None:
            self.at_first = bool(depth_m[0] > LEAST_M)
        deep = np.flatnonzero(depth_m > LEAST_M)
        if self.at_first or not len(deep):
            return
        most = int(np.argmax(depth_m))
        if depth_m[most] > self.deepest_m:
            self.deepest_m, self.step = float(depth_m[most]), int(samples[most])
        first, last = samples[deep[[0, -1]]].tolist()
        self.span = self.span[0] or first, last
        self.count += len(deep) * every

    def is_pressed(self, touched: Mapping[PairKey, TouchedLinks]) -> bool:
        """Return whether the same links or bodies were in contact elsewhere.

        For shapes of two bodies with collision groups of their own, contact between any shapes of
        these bodies counts; otherwise only contact between the same links.
        """
        bodies = frozenset(shape.body.number for shape in self.shapes)
        whole = len(bodies) > 1 and self.shapes[0].solid.collision.bits is not None
        return any(
            pair.pressed_step > self.since
            and (
                frozenset((key[::2], key[1::2])) == self.places or (whole and {*key[:2]} == bodies)
            )
            for key, pair in touched.items()
        )


class Overlaps:
    """All overlaps between shapes that make no contact; filled chunk by chunk."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen
        held = [*_shapes(seen)]
        self._held: dict[Place, list[HeldShape]] = {}
        for shape in held if len(held) <= MOST_SHAPES else ():
            self._held.setdefault(shape.place, []).append(shape)
        pairs = [*self._excluded()]
        self._pairs = pairs if len(pairs) <= MOST_PAIRS else []
        self._switched: dict[frozenset[Place], list[Overlap]] = {}
        """Pairs whose contacts calls have disabled."""
        self._groups: dict[Place, tuple[int, int]] = {}
        """Collision groups and masks that calls gave links."""

    def add(self, explained: ExplainedPiece) -> None:
        """Add a chunk of explained steps."""
        self._switch(explained.piece.calls)
        last = max(self._seen.samples.values(), default=0)
        first, end = max(explained.piece.first, 1), min(explained.piece.end, last)
        if not self._pairs or end <= first:
            return
        looks = int(np.clip(POSES // len(self._pairs), *LOOKS))
        samples = np.unique(np.linspace(first, end - 1, looks).astype(np.int64))
        every, poses = max(1, (end - first) // looks), dict[Place, tuple[Float64, Float64]]()
        for pair in self._pairs:
            if pair.at_first:  # it is taken as designed, however deep it gets
                continue
            for place in pair.places - poses.keys():
                poses[place] = explained.placed(*place, samples)
            one, other = (poses[shape.place] for shape in pair.shapes)
            known = np.isfinite(one[0] + other[0]).all(axis=1)
            rows = np.flatnonzero(known & (samples > pair.since) & (samples <= pair.until))
            if len(rows):
                (a, at_a), (b, at_b) = (
                    (shape.solid, (place_m[rows], axes[rows]))
                    for shape, (place_m, axes) in zip(pair.shapes, (one, other), strict=True)
                )
                pair.add(samples[rows], overlap_m(a, at_a, b, at_b), every)

    def rows(
        self,
        subjects: Mapping[int, MeasuredBody],
        touched: Mapping[PairKey, TouchedLinks],
        words: RowWords,
    ) -> Iterator[AccountRow]:
        """Yield a row for each pair of links that overlapped without a contact to separate them."""
        ranked = sorted(self._pairs, key=lambda pair: pair.deepest_m)
        for pair in {pair.places: pair for pair in ranked if pair.deepest_m}.values():
            one, other = pair.shapes
            its = (subjects.get(each.body.number) for each in pair.shapes)
            sizes_m = [each.size_m for each in its if each is not None]
            sizes_m = sizes_m or [2 * each.solid.radius_m for each in pair.shapes]
            share = pair.deepest_m / min(sizes_m)
            if pair.is_pressed(touched) or (pair.cause in DESIGNED and share < DEEP):
                continue
            line = "" if pair.call is None else pair.call.site.place
            told = Message(
                "at least {depth} inside each other at {time} s, and no force acts: {why}",
                depth=quantity(pair.deepest_m, "m"),
                time=f"{words.seconds(one.body, pair.step):.3g}",
                why=Message(WHY[pair.cause], line=line),
            )
            yield AccountRow(
                kind="idle",
                pair=(str(words.names.link(*one.place)), str(words.names.link(*other.place))),
                told=told,
                got=pair.deepest_m,
                unit="m",
                other=None if one.body is other.body else other.body.label,
                step=pair.step,
                salience=min(1.2, share + 0.4 * (share > DEEP)),
                subject=one.body,
                group=("overlap", pair.cause, one.solid.radius_m, other.solid.radius_m),
                cause=pair.cause,
                span=(*pair.span, pair.count),
                noted={"shapes": pair.shapes, "call": pair.call, "count": pair.count},
            )

    def _excluded(self) -> Iterator[Overlap]:
        """Yield pairs of shapes whose contacts are disabled, with the reason."""
        clients = {body.client for body in self._seen.bodies.values()}
        off = {client for client in clients if is_off(self._seen, client, NO_CONTACT)}
        apart = {
            frozenset(((body.number, own), (other, its)))
            for body in self._seen.bodies.values()
            for own, other, its in body.apart
        }
        for pair in combinations([each for held in self._held.values() for each in held], 2):
            one, other = sorted(pair, key=lambda each: (not each.is_seen, not each.moves))
            if _may_meet(one, other):
                excluded = frozenset((one.place, other.place)) in apart
                cause = _cause(one, other, excluded=excluded, no_contacts=one.body.client in off)
                if cause is not None:
                    yield Overlap((one, other), cause)

    def _switch(self, calls: Log) -> None:
        """Note calls that disable or enable contacts of links."""
        for call in calls.of(*FILTERS):
            given = {name: int(value[0]) for name, value in call.values.items() if value}
            came = [calls.body_at(call, given[name]) for name in PAIR if name in given]
            links = given.get("linkIndexA", BASE), given.get("linkIndexB", BASE)
            places = [(each.body.number, k) for each, k in zip(came, links, strict=False) if each]
            others = places[1:]
            if call.act is Act.FILTER_GROUP and places:
                names = "collisionFilterGroup", "collisionFilterMask"
                group, mask = (given.get(name, 0) for name in names)
                self._groups[places[0]], others = (group, mask), [*self._held]
            for place in others:
                self._switch_pair(call, places[0], place, on=bool(given.get("enableCollision")))

    def _switch_pair(self, call: Call, one: Place, other: Place, *, on: bool) -> None:
        cause = None if on else "filter"
        if call.act is Act.FILTER_GROUP:
            both = [self._groups.get(place) for place in (one, other)]
            of_one, of_other = both[0] or (0, 0), both[1] or USUAL[self._held[other][0].moves]
            meets = of_one[0] & of_other[1] or of_other[0] & of_one[1]
            cause = None if meets else "filter" if both[1] is None else "groups"
        key = frozenset((one, other))
        before = self._switched.get(key, [])
        if any(pair.cause == cause for pair in before):
            return
        for pair in before:
            pair.until = call.at.step
        pairs = product(self._held.get(one, ()), self._held.get(other, ()))
        found = [Overlap(both, cause, call) for both in pairs if cause and _may_meet(*both)]
        self._switched[key] = found if len(self._pairs) < MOST_PAIRS else []
        self._pairs += self._switched[key]


def _shapes(seen: Seen) -> Iterator[HeldShape]:
    """Yield the shapes of all bodies; visual ones only where there are no collision shapes."""
    puts = Counter(put.body.number for put in seen.puts)
    for body in seen.bodies.values():
        shapes = [*body.collisions]
        planes = any(shape.kind == "plane" for shape in shapes)
        for each in body.shapes:
            if not body.collisions or (each.kind == "plane" and not planes):
                place = each.position_m, each.orientation
                # The size of a plane that is only seen is a scale, that of others their normal.
                size_m = () if each.kind == "plane" else each.size_m
                shapes.append(Collision(each.link, each.kind, size_m, "", *place, bits=(0, 0)))
        if not shapes and body.base_moves and not body.joints and not body.soft:
            shapes.append(POINT)
        for shape in shapes:
            moves = bool(body.moving) and (shape.link in body.moving or body.base_moves)
            solid = solid_of(shape) if len(shape.hull_m) <= 3 * MOST_CORNERS else None
            if solid is not None:
                is_seen = shape is POINT or not any(shape.bits or (True,))
                yield HeldShape(body, solid, is_seen, moves or puts[body.number] > 1)


def _may_meet(one: HeldShape, other: HeldShape) -> bool:
    """Return whether two shapes belong to parts that can move relative to each other."""
    (a, link_a), (b, link_b) = ((each.body, each.solid.collision.link) for each in (one, other))
    if a is b and _root(a, link_a) == _root(a, link_b):
        return False
    return a.client == b.client and (one.moves or other.moves)


def _cause(one: HeldShape, other: HeldShape, *, excluded: bool, no_contacts: bool) -> str | None:
    """Return why two shapes make no contact, as a key of `WHY`; None if they can.

    If only one of the shapes is visual, it must be `one`.
    """
    a, b, bits = one.body, other.body, other.solid.collision.bits
    if one.is_seen:
        # A visual shape is a marker or a design, unless it falls, or has to carry a falling body.
        carries = b.base_moves and (a.joints or one.solid.collision.kind == "plane")
        if other.is_seen or a is b or not (a.base_moves or carries):
            return None
    if no_contacts:
        return None if a is b else "flag"
    if excluded:
        return "exclude"
    if one.is_seen:
        return "no-shape" if bits is None else "bits"
    if one.solid.collision.bits is not None and bits is not None:
        (type_a, with_a), (type_b, with_b) = one.solid.collision.bits, bits
        if not (type_a & with_b or type_b & with_a):
            return "bits"
        # A child of what cannot move does collide with it.
        parent, _ = sorted((one.place[1], other.place[1]))
        return "parent-and-child" if parent in a.moving and _is_child(one, other) else None
    if a is b:
        if not a.flags & SELF_COLLISION:
            return "one-robot"
        return None if a.flags & OF_PARENTS or not _is_child(one, other) else "parent-and-child"
    if not a.moving and not b.moving:
        return "both-static"
    of_links = [each for each in (one, other) if _counts_static(*each.place[1:], each.body)]
    still = [each for each in (one, other) if not each.body.moving]
    return "link-counted-static" if of_links and still else None


def _is_child(one: HeldShape, other: HeldShape) -> bool:
    """Return whether one link is the child of another and rotates on it.

    A link that slides on its parent may be made to slide into it, as a telescope's tubes are.
    """
    parent, link = sorted((one.place[1], other.place[1]))
    body = one.body
    if body is not other.body or body.joints[link].kind == "prismatic":
        return False
    above = body.joints[link].parent
    # A link whose name has a slash is between two joints of one body of the model.
    while above not in (BASE, parent) and "/" in body.links[above + 1]:
        above = body.joints[above].parent
    return above == parent


def _counts_static(link: int, body: Body) -> bool:
    """Return whether a link is rigidly connected to a base that cannot move."""
    if body.base_moves or link == 0 or link not in body.moving:
        return False
    root = _root(body, link)
    return root == 0 and bool(body.joints[0].widths[1])


def _root(body: Body, link: int) -> int:
    """Return the link from which a chain of fixed joints leads to the given link."""
    while link > BASE and not body.joints[link].widths[1]:
        link = body.joints[link].parent
    return link

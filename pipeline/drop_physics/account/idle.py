"""Rows for causes without effect: shapes that overlap without force, actuators without force."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations, product

import numpy as np

from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.terms import Term
from drop_physics.account.words import RowWords
from drop_physics.arrays import Float64
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.solids import Solid, overlap_m, solid_of
from drop_physics.messages import Message
from drop_physics.physics.tree import BASE
from drop_physics.quantities import number, quantity
from drop_physics.trace.calls import Push
from drop_physics.trace.events import Actuator, Body, Collision
from drop_physics.trace.history import Seen
from drop_physics.trace.switches import NO_ACTUATION, NO_CONTACT, NO_GRAVITY, is_off

LOOKS = 16
"""Number of evenly spaced samples of a chunk that are checked for overlaps."""
MOST_PAIRS = 400
"""Maximum number of shape pairs that are checked: in a larger world, filters are intentional."""
MOST_CORNERS = 1000
"""Maximum number of corners of a hull that is checked, because larger hulls take too long."""
DEEP = 0.05
"""Share of the smaller body's size above which an overlap counts."""
SELF_COLLISION, OF_PARENTS = 8, 16 | 32 | 8192
"""`flags` of `loadURDF`: `URDF_USE_SELF_COLLISION`, and those that control contacts between parent
and child."""

NO_FORCES = ("bias", "integrator", "remainder")
"""Causes of a sum that are not forces."""
SLOW = 0.01
"""A body that moves by less than this share of its size per second counts as standing still."""

Place = tuple[int, int]
"""A body id, and a link of the body."""


@dataclass(eq=False)
class Overlap:
    """Two overlapping shapes between which no contact is possible."""

    places: tuple[Place, Place]
    solids: tuple[Solid, Solid]
    why: Message
    at_first: bool | None = None
    """Whether the shapes overlap at the first check."""
    deepest_m: float = 0.0
    step: int = -1


@dataclass(eq=False)
class Overlaps:
    """Overlaps of shapes that make no contact; grows chunk by chunk."""

    seen: Seen
    pairs: list[Overlap] = field(init=False)

    def __post_init__(self) -> None:
        pairs = [*_pairs_without_contact(self.seen)]
        self.pairs = pairs if len(pairs) <= MOST_PAIRS else []

    def add(self, explained: ExplainedPiece) -> None:
        """Add a chunk."""
        piece = explained.piece
        for call, bodies in piece.calls.filters():
            self.pairs += _pairs_filtered(self.seen, call.site.place, bodies)
        last = max(self.seen.samples.values(), default=0)
        first, end = max(piece.first, 1), min(piece.end, last)
        if not self.pairs or end <= first:
            return
        samples = np.unique(np.linspace(first, end - 1, LOOKS).astype(np.int64))
        poses: dict[Place, tuple[Float64, Float64]] = {}
        for pair in self.pairs:
            for place in pair.places:
                if place not in poses:
                    poses[place] = explained.placed(*place, samples)
            one, other = (poses[place] for place in pair.places)
            if not (np.isfinite(one[0]).all() and np.isfinite(other[0]).all()):
                continue
            depth_m = overlap_m(pair.solids[0], one, pair.solids[1], other)
            if pair.at_first is None:
                pair.at_first = bool(depth_m[0] > 0)
            most = int(np.argmax(depth_m))
            if depth_m[most] > pair.deepest_m:
                pair.deepest_m, pair.step = float(depth_m[most]), int(samples[most])

    def rows(
        self,
        subjects: Mapping[int, MeasuredBody],
        touched: Collection[frozenset[int]],
        words: RowWords,
    ) -> Iterator[AccountRow]:
        """Yield a row for each pair of links that overlapped without a contact to separate them."""
        deepest: dict[frozenset[Place], Overlap] = {}
        for pair in self.pairs:
            key = frozenset(pair.places)
            if not pair.at_first and pair.deepest_m > 0:
                known = deepest.get(key)
                deepest[key] = pair if known is None or pair.deepest_m > known.deepest_m else known
        for pair in deepest.values():
            its = [subjects[place[0]] for place in pair.places if place[0] in subjects]
            if not its or frozenset(place[0] for place in pair.places) in touched:
                continue
            size_m = min(each.size_m for each in its)
            if pair.deepest_m < DEEP * size_m:
                continue
            names = [str(words.names.link(*place)) for place in pair.places]
            told = Message(
                "{depth} inside each other at {time}, and no force acts: {why}",
                depth=quantity(pair.deepest_m, "m"),
                time=words.time(its[0], pair.step),
                why=pair.why,
            )
            yield AccountRow(
                kind="idle",
                pair=(names[0], names[1]),
                told=told,
                got=pair.deepest_m,
                unit="m",
                step=pair.step,
                salience=min(1.2, 0.4 + pair.deepest_m / size_m),
                subject=its[0].body,
                group=("overlap", tuple(str(each.kind) for each in its), str(pair.why)),
            )


def _pairs_without_contact(seen: Seen) -> Iterator[Overlap]:
    """Yield the pairs of shapes that could collide but make no contact, with the reason."""
    held = [
        (body, shape, solid, touchable)
        for body in seen.bodies.values()
        for shape, touchable in _shapes(body)
        if len(shape.hull_m) <= 3 * MOST_CORNERS and (solid := solid_of(shape)) is not None
    ]
    if len(held) > 200:
        return
    apart = {
        frozenset(((body.number, own), (other, its)))
        for body in seen.bodies.values()
        for own, other, its in body.apart
    }
    off = {
        client
        for client in {body.client for body in seen.bodies.values()}
        if is_off(seen, client, NO_CONTACT)
    }
    for (a, shape_a, solid_a, can_a), (b, shape_b, solid_b, can_b) in combinations(held, 2):
        if a.client != b.client or not (_moves(a, shape_a.link) or _moves(b, shape_b.link)):
            continue
        if a is b and _root(a, shape_a.link) == _root(a, shape_b.link):
            continue
        places = (a.number, shape_a.link), (b.number, shape_b.link)
        why = _why(a, b, (shape_a, can_a), (shape_b, can_b), excluded=frozenset(places) in apart)
        if a is not b and a.client in off:
            why = Message("a flag of the model switches contacts off")
        if why is not None:
            yield Overlap(places, (solid_a, solid_b), why)


def _pairs_filtered(seen: Seen, line: str, bodies: Collection[int]) -> Iterator[Overlap]:
    """Yield the pairs of shapes with filtered contacts, between one body and all others."""
    held = {
        body.number: [
            (shape.link, solid)
            for shape in body.collisions
            if len(shape.hull_m) <= 3 * MOST_CORNERS and (solid := solid_of(shape)) is not None
        ]
        for body in seen.bodies.values()
    }
    for a, b in combinations(seen.bodies.values(), 2):
        its = {a.number, b.number} & {*bodies}
        if len(its) == len({*bodies}) and a.client == b.client and (a.moving or b.moving):
            why = Message("{line} filters their contacts", line=line)
            for (link_a, solid_a), (link_b, solid_b) in product(held[a.number], held[b.number]):
                yield Overlap(((a.number, link_a), (b.number, link_b)), (solid_a, solid_b), why)


def _shapes(body: Body) -> Iterator[tuple[Collision, bool]]:
    """Yield the shapes of a body, and whether each can collide; if none can, the visual shapes."""
    for shape in body.collisions:
        yield shape, shape.bits is None or any(shape.bits)
    if not body.collisions:
        for seen in body.shapes:
            place = seen.position_m, seen.orientation
            yield Collision(seen.link, seen.kind, seen.size_m, "", *place), False


def _why(
    a: Body,
    b: Body,
    one: tuple[Collision, bool],
    other: tuple[Collision, bool],
    *,
    excluded: bool,
) -> Message | None:
    """Return the reason why two shapes make no contact; None if they can."""
    (shape_a, can_a), (shape_b, can_b) = one, other
    if not (can_a or can_b):
        return None
    if not (can_a and can_b):
        ghost, shape = (b, shape_b) if can_a else (a, shape_a)
        # What is only seen is a marker or a design, unless it falls or is to carry what falls.
        if ghost.base_moves or shape.kind == "plane":
            return Message("{part} has no shape that anything can touch", part=_part(ghost, shape))
        return None
    if excluded:
        return Message("the model excludes their contact")
    if shape_a.bits is not None and shape_b.bits is not None:
        (type_a, with_a), (type_b, with_b) = shape_a.bits, shape_b.bits
        if not (type_a & with_b or type_b & with_a):
            return Message(
                "collision groups and masks {a} and {b} share no bit",
                a=f"{type_a}/{with_a}",
                b=f"{type_b}/{with_b}",
            )
        if a is b and _is_parent(a, shape_a.link, shape_b.link):
            return Message("one is the parent of the other")
        return None
    if a is not b:
        if not a.moving and not b.moving:
            return Message("neither has mass")
        return None
    if not a.flags & SELF_COLLISION:
        return Message("links of one body, which was loaded without self-collision")
    if not a.flags & OF_PARENTS and _is_parent(a, shape_a.link, shape_b.link):
        return Message("one is the parent of the other")
    return None


def _part(body: Body, shape: Collision) -> str:
    single = len(body.links) < 2 or shape.link + 1 >= len(body.links)
    return body.label if single else body.links[shape.link + 1]


def _moves(body: Body, link: int) -> bool:
    return bool(body.moving) and (link in body.moving or body.base_moves)


def _is_parent(body: Body, one: int, other: int) -> bool:
    """Return whether one of two links is the parent of the other."""
    link, parent = max(one, other), min(one, other)
    return link > BASE and body.joints[link].parent == parent


def _root(body: Body, link: int) -> int:
    """Return the first link of a chain of fixed joints that contains a link."""
    while link > BASE and not body.joints[link].widths[1]:
        link = body.joints[link].parent
    return link


class PushedSoft:
    """The forces and torques of calls on soft bodies; grows chunk by chunk."""

    def __init__(self) -> None:
        self._most: dict[int, tuple[Push, int]] = {}
        """The strongest push on each body, and the number of pushes, by body id."""

    def add(self, explained: ExplainedPiece) -> None:
        """Add a chunk."""
        for push in explained.piece.calls.pushes():
            if push.body.soft:
                most, calls = self._most.get(push.body.number, (push, 0))
                stronger = np.linalg.norm(push.vector) > np.linalg.norm(most.vector)
                self._most[push.body.number] = push if stronger else most, calls + 1

    def rows(self) -> Iterator[AccountRow]:
        """Yield a row for each soft body that calls push without effect."""
        for push, calls in self._most.values():
            unit = "N m" if push.torque else "N"
            most = float(np.linalg.norm(push.vector))
            yield AccountRow(
                kind="idle",
                told=Message(
                    "pushed with up to {force} in {calls:,} calls; it is soft, and no such force "
                    "acts on what is soft",
                    force=quantity(most, unit),
                    calls=calls,
                ),
                asked=most,
                got=0.0,
                gap=-most,
                unit=unit,
                step=push.at.step,
                salience=0.8,
                subject=push.body,
            )


def unforced_row(subject: MeasuredBody, seen: Seen, gravity_m_s2: Float64) -> AccountRow | None:
    """Return the row for a free body on which no force acts, ever or at its end; None otherwise.

    The end is the last tenth of its steps; a body that stands still there has no such row.
    """
    ledger, client = subject.ledger, subject.body.client
    whole = ledger.window(ledger.first, ledger.last)
    tenth = max(1, int(np.count_nonzero(ledger.counts)) // 10) * ledger.width
    late = ledger.window(ledger.last - tenth, ledger.last)
    if subject.tree.fixed or not ledger.covers(late) or _acts(ledger.impulse, late, 6):
        return None
    never = ledger.covers(whole) and not _acts(ledger.impulse, whole, subject.tree.size)
    way_m = ledger.way[late, 3:6].sum(axis=0)
    speed = float(np.linalg.norm(way_m)) / float(ledger.seconds[late].sum())
    if never:
        told = Message(
            "no force acts on it in any of {steps:,} steps; gravity is {gravity} m/s²",
            steps=int(ledger.counts.sum()),
            gravity=number(float(np.linalg.norm(gravity_m_s2))),
        )
        if is_off(seen, client, NO_GRAVITY):
            told = told + Message(", which a flag of the model switches off")
    elif speed < SLOW * subject.size_m:
        return None
    else:
        told = Message(
            "no force acts on it in the last steps, and it goes on at {speed}",
            speed=quantity(speed, "m/s"),
        )
        told = told + _damping_of_base(subject.body, seen)
    return AccountRow(
        kind="idle",
        told=told,
        got=None if never else speed,
        unit=None if never else "m/s",
        step=ledger.last,
        salience=0.7 if never else 0.6,
        subject=subject.body,
        group=("unforced", never, subject.kind),
    )


def _acts(impulses: Mapping[Term, Float64], window: slice, rates: int) -> bool:
    """Return whether a force acts on any of a body's first rates in a window."""
    forces = (each for term, each in impulses.items() if term.cause not in NO_FORCES)
    return any(each[window, :rates].any() for each in forces)


def _damping_of_base(body: Body, seen: Seen) -> Message:
    """Return the damping of a free joint, if the engine reports it."""
    reported = [each.reported for each in seen.dynamics if each.body.number == body.number]
    damping = reported[-1].get("base_damping") if reported else None
    if damping is None or not np.isfinite(damping[0]):
        return Message("")
    return Message(
        "; the damping of its free joint is {damping}", damping=number(float(damping[0]))
    )


def idle_actuator_rows(
    subject: MeasuredBody, seen: Seen, controls: Mapping[Actuator, Float64]
) -> Iterator[AccountRow]:
    """Yield a row for each actuator that has a control but never exerted a force.

    A servo that stands at its target has none to give.
    """
    for actuator, given in controls.items():
        if actuator.kind == "position" or not np.isfinite(given).any():
            continue
        most = float(given[int(np.nanargmax(np.abs(given)))])
        acts = any(
            term.cause == f"actuator {actuator.name}" or term.name == actuator.name
            for term in subject.ledger.impulse
        )
        if most and not acts and subject.ledger.counts.any():
            told = Message(
                "ctrl up to {given}, and it gives no force in any step; it acts on {target}",
                given=number(most),
                target=actuator.target,
            )
            if is_off(seen, subject.body.client, NO_ACTUATION):
                told = told + Message("; a flag of the model switches actuators off")
            yield AccountRow(
                kind="idle",
                actuator=actuator.name,
                told=told,
                asked=most,
                got=0.0,
                salience=0.8,
                subject=subject.body,
                group=("idle actuator", subject.kind),
            )

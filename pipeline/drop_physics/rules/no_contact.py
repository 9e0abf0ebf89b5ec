"""`no-contact`: bodies overlap, and nothing pushes them apart, because they are no pair."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from drop_physics.data import dataclass
from drop_physics.explain.bodies import records_of
from drop_physics.explain.overlap import PlacedShape, is_convex, overlaps
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.rotations import products, quaternions, rotate
from drop_physics.physics.tree import BASE
from drop_physics.rules.answer import Answer, Cure, Finding, Level, Scene, Span
from drop_physics.rules.arguments import number, site_of
from drop_physics.rules.body_properties import part_named
from drop_physics.rules.rule import Said, finding_of
from drop_physics.rules.thresholds import DEEP_M, OVERLAPS_STEPS
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body, Collision

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Place = tuple[int, int]
"""Number of a body, and its link."""

LOOKS = 200
"""Number of steps of a piece, evenly spread, in which overlaps are looked for."""
SELF_COLLISION, OF_PARENTS = 8, 16 | 32 | 8192
"""`flags` of `loadURDF`: `URDF_USE_SELF_COLLISION`, and those that say whether a link collides with
its parent: …`_EXCLUDE_PARENT`, …`_EXCLUDE_ALL_PARENTS`, …`_INCLUDE_PARENT`."""


@dataclass
class _Passing:
    """Two links that no contact keeps apart, and why."""

    reason: str
    call: Call | None = None
    """That switched the pair off."""
    steps: list[int] = field(default_factory=list)
    """In which they overlap."""
    apart: bool = False
    """Whether they did not overlap before."""


class NoContact(Answer):
    """Looks for overlap only where the engine makes no contact: the others push."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._records = records_of(scene.seen)
        self._off: dict[tuple[Place, Place], Call] = {}
        """Pairs that a call switched off."""
        self._groups: dict[Place, Call] = {}
        """The latest call that gave a link its group and mask."""
        self._joined: set[frozenset[int]] = set()
        """Bodies that a constraint joined, and with them on purpose."""
        self._found: dict[tuple[Place, Place], _Passing] = {}

    def see(self) -> None:
        """Take a piece."""
        self._calls()
        self._shapes: dict[Place, list[Collision]] = {}
        for body_number, body in self.scene.seen.bodies.items():
            for shape in body.collisions:
                if is_convex(shape):
                    self._shapes.setdefault((body_number, shape.link), []).append(shape)
        pairs = {**{pair: _Passing(reason="filter", call=call) for pair, call in self._off.items()}}
        for pair, passing in self._unpaired():
            pairs.setdefault(pair, passing)
        for pair, passing in pairs.items():
            numbers = [place[0] for place in pair]
            by_mask = passing.call is not None and passing.call.act is Act.FILTER_GROUP
            left = self._tunnels(*numbers) and not by_mask
            if frozenset(numbers) not in self._joined and not left:
                self._look(pair, self._found.get(pair, passing))

    def _calls(self) -> None:
        calls = self.scene.piece.calls
        for call in calls.of(Act.CONSTRAIN):
            came = [
                calls.body_at(call, int(number(call, f"{role}BodyUniqueId", -1.0)))
                for role in ("parent", "child")
            ]
            self._joined.add(frozenset(each.body.number for each in came if each is not None))
        for call in calls.of(Act.FILTER_PAIR):
            came = [
                calls.body_at(call, int(number(call, f"bodyUniqueId{each}", -1.0))) for each in "AB"
            ]
            links = [int(number(call, f"linkIndex{each}", -1.0)) for each in "AB"]
            if came[0] is None or came[1] is None:
                continue
            first, second = came[0].body.number, came[1].body.number
            pair = (first, links[0]), (second, links[1])
            if number(call, "enableCollision", 1.0) == 0:
                self._off[pair] = call
            else:
                self._off.pop(pair, None)
                self._off.pop(pair[::-1], None)
        for call, _, one in calls.of_bodies(Act.FILTER_GROUP):
            self._groups[one.body.number, int(number(call, "linkIndexA", -1.0))] = call

    def _unpaired(self) -> Iterator[tuple[tuple[Place, Place], _Passing]]:
        """Yield pairs of links that the engine makes no contact of, and why."""
        bodies = self.scene.seen.bodies
        yield from self._excluded()
        posed = {use.body.number for use in self.scene.inputs.of(Act.SET_POSE) if use.body}
        asked = {
            frozenset((subject.body, subject.other))
            for each in self.scene.seen.readings
            if each.act is Act.READ_CONTACTS
            for subject in each.targets
        }
        still = [place for place in self._shapes if not bodies[place[0]].moving]
        for one, two in combinations(still, 2):
            if {one[0], two[0]} & posed and {
                frozenset((one[0], two[0])),
                frozenset((one[0], None)),
                frozenset((two[0], None)),
            } & asked:
                yield (
                    ((one, two) if one[0] in posed else (two, one)),
                    _Passing(reason="both-static"),
                )
        for body in bodies.values():
            places = [(body.number, link) for link in range(len(body.joints))]
            static = [place for place in places if self._counts_static(body, place[1])]
            for one, two in product([each for each in static if each in self._shapes], still):
                yield (one, two), _Passing(reason="link-counted-static")
            if body.flags & SELF_COLLISION and not body.flags & OF_PARENTS:
                for place in places:
                    parent = body.number, body.joints[place[1]].parent
                    if place in self._shapes and parent in self._shapes:
                        yield (place, parent), _Passing(reason="parent-and-child")
            if body.base_moves and not body.joints and not body.collisions and not body.soft:
                for other in self._shapes:
                    if bodies[other[0]].client == body.client:
                        yield ((body.number, BASE), other), _Passing(reason="no-shape")

    def _excluded(self) -> Iterator[tuple[tuple[Place, Place], _Passing]]:
        """Yield links of two bodies whose groups and masks, both given, exclude each other.

        One that meets the other's is enough, unless `collisionFilterMode` is 0. A group or mask of
        0 meets nothing on purpose.
        """
        given = {place: call for place, call in self._groups.items() if place in self._shapes}
        for one, two in combinations(given, 2):
            calls = given[one], given[two]
            group, mask = (
                [int(number(each, f"collisionFilter{name}")) for each in calls]
                for name in ("Group", "Mask")
            )
            meets = group[0] & mask[1], group[1] & mask[0]
            if one[0] != two[0] and all((*group, *mask)) and not any(meets):
                last = max(calls, key=lambda each: each.at.call)
                yield (one, two), _Passing(reason="filter", call=last)

    def _tunnels(self, *numbers: int) -> bool:
        """Return whether one goes through the other as `tunnelled` sees it: a box that stays."""
        bodies = [self.scene.body(each) for each in numbers]
        return any(
            one.base_moves
            and not one.joints
            and not other.moving
            and [shape.kind for shape in other.collisions] == ["box"]
            for one, other in (bodies, bodies[::-1])
        )

    def _counts_static(self, body: Body, link: int) -> bool:
        """Return whether a link is fixed to link 0, maybe by others, of a base without mass."""
        if body.base_moves or link == 0 or link not in body.moving:
            return False
        while link > 0:
            if body.joints[link].widths[1]:
                return False
            link = body.joints[link].parent
        return link == 0 and bool(body.joints[0].widths[1])

    def _look(self, pair: tuple[Place, Place], passing: _Passing) -> None:
        bodies = [self.scene.body(place[0]) for place in pair]
        if bodies[0].client != bodies[1].client:
            return
        moving = [body.number for body in bodies if body.number in self.scene.judged]
        piece, last = self.scene.piece, self.scene.seen.samples.get(bodies[0].client, 0)
        samples = np.arange(max(piece.first, 1), min(piece.end, last))
        for body in moving:
            mine = [steps.steps for _, steps in self.scene.stretches(body)]
            samples = np.intersect1d(samples, np.concatenate(mine)) if mine else samples[:0]
        if passing.call is not None:
            samples = samples[samples > passing.call.at.step]
        every = max(1, -(-len(samples) // LOOKS))
        samples = samples[::every]
        shapes = [self._placed(place, samples) for place in pair]
        if not len(samples) or not all(shapes):
            return
        deep = np.zeros(len(samples), np.bool_)
        for one, two in product(*shapes):
            deep |= overlaps(one, two, DEEP_M)
        deep &= ~np.isin(samples, self._pressed(pair))
        passing.apart |= not deep[0]
        for step in samples[deep].tolist() if passing.apart or len(moving) < 1 else ():
            passing.steps += range(step, step + every)
        if passing.steps:
            self._found[pair] = passing

    def _pressed(self, pair: tuple[Place, Place]) -> Int64:
        """Return the samples to which a contact of two links pushed."""
        pairs = self.scene.touches.pairs
        points = pairs.points
        (one, link), (two, other) = pair
        straight = (points.body == (one, two)).all(axis=1) & (points.link == (link, other)).all(1)
        turned = (points.body == (two, one)).all(axis=1) & (points.link == (other, link)).all(1)
        return np.asarray(points.step[(straight | turned) & (points.normal_n > 0)])

    def _placed(self, place: Place, samples: Int64) -> list[PlacedShape]:
        """Return the shapes of a link at samples; a point in place of none."""
        body_number, link = place
        if body_number not in self.scene.judged:
            if link != BASE:
                return []
            base = self._records[body_number].told(samples)
            centre_m, turned = base[:, :3], base[:, 3:7]
        else:
            found = []
            for _, steps in self.scene.stretches(body_number):
                rows = np.flatnonzero(np.isin(steps.steps, samples))
                if len(rows) and link < steps.law.tree.links:
                    kin = kinematics(steps.law.tree, steps.after.at(rows))
                    found.append((kin.position_m(link), quaternions(kin.rotations[link + 1])))
            if sum(len(each) for each, _ in found) != len(samples) or not found:
                return []
            centre_m, turned = (np.concatenate(each) for each in zip(*found, strict=True))
        point = Collision(link, "sphere", (DEEP_M,), "", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        return [
            PlacedShape(
                shape,
                centre_m + rotate(turned, np.tile(shape.position_m, (len(samples), 1))),
                products(turned, np.tile(shape.orientation, (len(samples), 1))),
            )
            for shape in self._shapes.get(place, [point])
        ]

    def findings(self) -> Iterator[Finding]:
        """Yield each pair of bodies that overlaps for long enough."""
        for pair, passing in self._found.items():
            if len(passing.steps) >= OVERLAPS_STEPS:
                yield self._finding(pair, passing)

    def _finding(self, pair: tuple[Place, Place], passing: _Passing) -> Finding:
        (one, link), (two, other_link) = pair
        body, other = self.scene.body(one), self.scene.body(two)
        names = [part_named(each, at) for each, at in ((body, link), (other, other_link))]
        why, advice, name, level = _WHY[passing.reason]
        made = self.scene.seen.samples[body.client] - 1
        call = passing.call
        values: dict[str, object] = {
            "body": names[0],
            "other": names[1],
            "steps": len(passing.steps),
        }
        values["why"] = Message(why, **values, function="" if call is None else call.function)
        said = Said(
            message=Message(
                "{body} gets into {other} in {steps:,} steps, and nothing pushes it out: {why}"
            ),
            values=values,
            reason=passing.reason,
            advice=advice,
            cure=None if name is None else Cure(name, body.label),
            other=None if one == two else other.label,
            share=len(passing.steps) / max(made, 1),
            steps=Span(passing.steps[0], passing.steps[-1], len(passing.steps)),
            site=None if call is None else site_of(call),
        )
        return finding_of("no-contact", level, said, self.scene, body.label)


_WHY: dict[str, tuple[Message, Message, str | None, Level]] = {
    "no-shape": (
        Message("{body} has no collision shape"),
        Message("give it one: p.createCollisionShape(…), in a URDF <collision>"),
        None,
        "asked",
    ),
    "both-static": (
        Message("neither has mass, and PyBullet makes no contacts between two static bodies"),
        Message("give the one that moves a mass: {call}"),
        "mass",
        "asked",
    ),
    "parent-and-child": (
        Message(
            "{other} is the parent of {body}, and without URDF_USE_SELF_COLLISION_INCLUDE_PARENT "
            "PyBullet makes no contacts between these"
        ),
        Message("load it with p.URDF_USE_SELF_COLLISION_INCLUDE_PARENT as well"),
        None,
        "note",
    ),
    "filter": (
        Message("a call of p.{function} switched this pair off"),
        Message("leave that call out"),
        None,
        "note",
    ),
    "link-counted-static": (
        Message(
            "{body} is fixed to the first link of a robot whose base is fixed, which makes it "
            "static for PyBullet, as {other} is"
        ),
        Message("make its joint revolute, with limits of -0.001 and 0.001, or give {other} a mass"),
        None,
        "asked",
    ),
}
"""Why, what helps, by which intervention, and how grave it is, by reason."""

"""`no-contact`: bodies go into each other, and the model lets no contact be made between them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.bodies import records_of
from drop_physics.explain.solids import Solid, overlap_m, solid_of
from drop_physics.messages import Message
from drop_physics.physics.columns import rotation
from drop_physics.physics.kinematics import Kinematics, kinematics
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Notes, Scene
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.thresholds import DEEP_M, OVERLAPS_STEPS
from drop_physics.trace.events import Body, Collision

Float64 = NDArray[np.float64]
BASE = -1
MOST_PAIRS = 200
"""Pairs of shapes that are looked at: in a world of more, filters are a design."""
EVERY = 2000
"""Steps of a piece that are looked at."""


@dataclass(frozen=True)
class FilteredPair:
    """Two shapes of which the model keeps contacts away."""

    bodies: tuple[int, int]
    solids: tuple[Solid, Solid]
    is_excluded: bool = False
    """Whether the model excludes them by name."""
    is_family: bool = False
    """Whether one is the parent of the other; else their bits have nothing in common."""


class FilteredOut(Answer):
    """Shapes that did not overlap at first, of bodies that never touch, go into each other."""

    engines = MUJOCOS

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._records = records_of(scene.seen)
        self._pairs = [*_filtered(scene)]
        if len(self._pairs) > MOST_PAIRS:
            self._pairs = []
        self._found: Notes[int] = Notes()
        """How deep pairs overlap [m], by the place of a pair."""
        self._at_first: set[int] = set()
        """Pairs that overlap from the beginning on."""

    def see(self) -> None:
        """Take a piece."""
        if not self._pairs:
            return
        poses: dict[int, tuple[NDArray[np.int64], Kinematics]] = {}
        for number, judged in self.scene.judged.items():
            stretches = [each for each in judged.stretches if len(each)]
            if len(stretches) == 1:  # else its model is edited on the way
                (its,) = stretches
                rows = _some(len(its))
                poses[number] = (
                    its.steps[rows] - 1,
                    kinematics(its.law.tree, its.before.at(rows)),
                )
        for place, pair in enumerate(self._pairs):
            if place in self._at_first or not any(each in poses for each in pair.bodies):
                continue
            lead = next(each for each in pair.bodies if each in poses)
            steps = poses[lead][0]
            where = [
                self._where(number, solid.collision.link, steps, poses.get(number))
                for number, solid in zip(pair.bodies, pair.solids, strict=True)
            ]
            if where[0] is None or where[1] is None:
                continue
            depth = overlap_m(pair.solids[0], where[0], pair.solids[1], where[1])
            if steps[0] == 0 and depth[0] > 0:
                self._at_first.add(place)
                continue
            rows = np.flatnonzero(depth > DEEP_M)
            if len(rows):
                self._found.add(place, steps[rows] + 1, depth[rows])

    def _where(
        self,
        number: int,
        link: int,
        steps: NDArray[np.int64],
        pose: tuple[NDArray[np.int64], Kinematics] | None,
    ) -> tuple[Float64, Float64] | None:
        """Return positions and rotations of a link as steps begin; None if they are not known."""
        if pose is not None:
            same = len(pose[0]) == len(steps) and bool((pose[0] == steps).all())
            return (pose[1].position_m(link), pose[1].matrix(link)) if same else None
        if link != BASE or number not in self._records:
            return None
        base = self._records[number].told(steps)
        return base[:, :3], np.moveaxis(rotation(base[:, 3:7].T), -1, 0)

    def findings(self) -> Iterator[Finding]:
        """Yield the deepest of each two bodies that never touched."""
        worst: dict[tuple[int, int], int] = {}
        for place, noted in self._found.items():
            bodies = self._pairs[place].bodies
            first, second = sorted(bodies)
            if noted.count < OVERLAPS_STEPS or place in self._at_first:
                continue
            if (first, second) in self.scene.inputs.touched:
                continue
            known = worst.get((first, second))
            if known is None or noted.most > self._found[known].most:
                worst[first, second] = place
        for place in worst.values():
            yield self._finding(self._pairs[place], place)

    def _finding(self, pair: FilteredPair, place: int) -> Finding:
        noted = self._found[place]
        bodies = [self.scene.body(number) for number in pair.bodies]
        names = [
            body.links[solid.collision.link + 1]
            if bodies[0] is bodies[1]
            else _named(body, solid.collision)
            for body, solid in zip(bodies, pair.solids, strict=True)
        ]
        values = {"a": names[0], "b": names[1], "depth": noted.most * 1e3}
        links = [
            body.links[solid.collision.link + 1]
            for body, solid in zip(bodies, pair.solids, strict=True)
        ]
        form = ""
        if not (pair.is_excluded or pair.is_family):
            (type_a, with_a), (type_b, with_b) = (
                solid.collision.bits or (0, 0) for solid in pair.solids
            )
            why = Message(
                "contype {type_a} and conaffinity {with_a} of {a} have no bit in common with "
                "conaffinity {with_b} and contype {type_b} of {b}",
                type_a=type_a,
                with_a=with_a,
                type_b=type_b,
                with_b=with_b,
                **values,
            )
            cure, call = (
                "contype",
                Message('contype="1" conaffinity="1" of both <geom>s, or bits that meet'),
            )
        elif pair.is_excluded:
            why = Message("an <exclude> of the model names both", **values)
            cure, form = "exclude", "out"
            call = Message("take that <exclude> out of <contact>")
        else:
            why = Message("{a} is the parent of {b}, and parent and child do not collide", **values)
            cure, call = (
                "filterparent",
                Message('<option><flag filterparent="disable"/></option>, or a range of the joint'),
            )
        return Finding(
            code="no-contact",
            level="model",
            reason="parent-and-child" if pair.is_family else "filter",
            message=Message(
                "{a} and {b} go at least {depth:.3g} mm into each other and never touch: {why}",
                why=why,
                **values,
            ),
            advice=call,
            cure=Cure(cure, call=call, form=form, given={"links": links}),
            body=bodies[0].label,
            other=None if bodies[0] is bodies[1] else bodies[1].label,
            effect=Effect(noted.most, "m"),
            share=noted.most / DEEP_M,
            steps=noted.span,
        )


def _some(count: int) -> NDArray[np.intp]:
    """Return rows of a piece, all if they are not too many."""
    return np.arange(0, count, max(1, -(-count // EVERY)))


def _named(body: Body, collision: Collision) -> str:
    single = len(body.links) < 2
    return body.label if single else body.links[collision.link + 1]


def _filtered(scene: Scene) -> Iterator[FilteredPair]:
    """Yield the pairs of shapes of which the model keeps contacts away, and which may meet."""
    shapes = [
        (body, collision, solid)
        for body in scene.seen.bodies.values()
        for collision in body.collisions
        if collision.bits is not None and (solid := solid_of(collision)) is not None
    ]
    apart = {
        frozenset(((body.number, own), (other, its)))
        for body in scene.seen.bodies.values()
        for own, other, its in body.apart
    }
    for place, (body_a, a, solid_a) in enumerate(shapes):
        for body_b, b, solid_b in shapes[place + 1 :]:
            if body_a.client != body_b.client or not (body_a.moving or body_b.moving):
                continue
            assert a.bits is not None
            assert b.bits is not None
            bodies, solids = (body_a.number, body_b.number), (solid_a, solid_b)
            meets = bool(a.bits[0] & b.bits[1] or b.bits[0] & a.bits[1])
            excluded = frozenset(((body_a.number, a.link), (body_b.number, b.link))) in apart
            if body_a is not body_b and (excluded or not meets):
                yield FilteredPair(bodies, solids, is_excluded=excluded)
            elif body_a is body_b and meets and not excluded and _is_child(body_a, a.link, b.link):
                yield FilteredPair(bodies, solids, is_family=True)


def _is_child(body: Body, one: int, other: int) -> bool:
    """Return whether of two links one is the child of the other, which can move."""
    link, parent = max(one, other), min(one, other)
    if link == parent or parent not in body.moving:
        return False
    above = body.joints[link].parent
    while above != BASE and above != parent and not _whole(body, above):
        above = body.joints[above].parent
    return above == parent


def _whole(body: Body, link: int) -> bool:
    """Return whether a link is a body of the model, and not between two joints of one."""
    return "/" not in body.links[link + 1]
